"""When a lagged tangent is renewed, and what a restart needs to make the same one again."""

from .transfer import Rates

WEAR_FACTOR, WEAR_OFFSET = 1.5, 2


class TangentRule:
    """Keep a tangent over iterations and steps while the coupling iteration stays as quick as when it was made.

    Renew it when the rates (step size) change, or when the last step took more than 1.5 n + 2 iterations, n those of the first
    step with it.  Renewal happens between steps, so that the linearization point is an accepted state, which a checkpoint can
    hold.  A linear phase renews its tangent only with the rates and stores no point.
    """

    def __init__(self, linear):
        """Start without a tangent."""
        self._linear = linear
        self.rates, self._point, self._built_with = None, {}, None

    def due(self, rates, iterations):
        """Return whether a new tangent is wanted at the start of a step; iterations are those of the last step, 0 at first."""
        if rates != self.rates:
            return True
        if self._built_with is None:
            self._built_with = iterations
        return not self._linear and iterations > WEAR_FACTOR * self._built_with + WEAR_OFFSET

    def store(self, rates, fields):
        """Remember the rates and the linearization point, name -> (n_local, ...)."""
        self.rates, self._built_with = rates, None
        self._point = {} if self._linear else {name: field.copy() for name, field in fields.items()}

    def forget(self):
        """Make the next `due` true."""
        self.rates = None

    def state(self, n_owned):
        """Return the linearization point on the owned nodes for a checkpoint."""
        return {f"tangent_{name}": field[:n_owned] for name, field in self._point.items()}

    def memory(self):
        """Return the rates and the iteration count of the rule for a checkpoint."""
        rates = None if self.rates is None else [self.rates.c_f, self.rates.c_v, self.rates.c_a]
        return {"rates": rates, "built_with": self._built_with}

    def load(self, arrays, memory, mesh):
        """Restore from a checkpoint; return the linearization point (empty for a linear phase), None without a tangent."""
        self.rates = None if memory["rates"] is None else Rates(*memory["rates"])
        self._built_with = memory["built_with"]
        if self.rates is None:
            return None
        named = {name.removeprefix("tangent_"): array for name, array in arrays.items() if name.startswith("tangent_")}
        self._point = {name: mesh.halo.extend(owned) for name, owned in named.items()}
        return self._point
