"""When a step is converged: the true residual of every field over the forces of its balance."""

from math import isfinite

from ..errors import SMALLER_STEP, ConvergenceError

# A residual below this part of the largest force of the run is round-off (measured at rest under a
# prescribed pressure: 1.2e-15). The forces on the fluid count with those on the skeleton: n ∇p of a
# closed body under a load is the round-off of its pressure, and its volume rates, where a scheme
# knows their weight in forces, that of the skeleton's equilibrium.
ROUND_OFF = 1e-13
# The drag S (v_f - v_s) is a difference of forces S v that cancel: its round-off (measured at k_f =
# 1e-12 m/s on both orders and three steps: 0.13 to 0.32 of this times |S v_f|); v_s = c_v Δu has
# that of S c_v u.
EPSILON = 2.2e-16
# Above this part of the largest force present that round-off would pass for the balance of the
# fluid (1e-4 at k_f = 1e-14 m/s).
BLIND = 1e-2
# A fitting tangent contracts by 0.45 or better per sweep (measured over all permeabilities, see
# GUARDS in coupling/porous.py), but at large strain a new one is worth it before: Anderson takes up
# to 13 sweeps in the coupling study with 0.45, 12 with 0.35.
SLOW = 0.35
WARM_UP = 4
# Where the iterations of a step fall no further below this, their tolerance asks for more digits
# than there are.
STALL = 1e-6


class Convergence:
    """Residual norm of each field over the largest norm of a term of that field's balance.

    For the momentum balances it is the largest term of the present iterate: on the first one the
    drag of the predicted velocities can be 1e8 times what it is at the end (measured at k_f = 1e-12
    m/s), and would let anything pass.  The terms of the volume balance vanish together in an
    undrained motion; for it the largest term of all iterates of the step counts, but no more than
    what cancels inside the present ones where that is known: an iteration that strays and comes
    back must not end early.
    """

    def __init__(self, tolerance: float) -> None:
        """Take the tolerance; `largest` (field -> norm) of the steps that converged belongs to the
        run and its checkpoints.
        """
        self.tolerance = tolerance
        self.largest: dict[str, float] = {}
        self.history: list[dict[str, float]] = []

    def start_step(self) -> None:
        """Forget the scales of the last step.

        force_per_rate : of the volume balance [N s/m³], infinite where it is not known;
        flow_force_per_rate : the same for forces of the fluid alone
        """
        self._scales: dict[str, float] = {}
        self._present: dict[str, float] = {}
        self.history = []
        self.force_per_rate = self.flow_force_per_rate = float("inf")

    def reached(
        self, norms: dict[str, tuple[float, float]], drag: float, cancelling: dict[str, float]
    ) -> bool:
        """Record the residuals, field -> (residual norm, largest term norm), and return whether all
        are within the tolerance.

        drag : the force S v_f or S c_v u [N], whose round-off the momentum residuals have;
        ConvergenceError where it drowns them
        cancelling : field -> norm of what cancels inside its terms, whose round-off is all that is
        left of a uniform flow
        """
        errors = {}
        for field, (_, force) in norms.items():
            self._scales[field] = (
                max(force, self._scales.get(field, 0.0)) if field == "volume" else force
            )
            self._present[field] = max(force, self.largest.get(field, 0.0))
        of_fluid = cancelling.get("fluid momentum", 0.0)
        for field, (residual, _) in norms.items():
            # a uniform pressure in a sealed body leaves a seepage by the round-off of its gradient
            also = of_fluid / self.flow_force_per_rate if field == "volume" else drag
            inside = EPSILON * max(also, cancelling.get(field, 0.0))
            round_off = max(ROUND_OFF * self._largest_like(field), inside)
            errors[field] = (
                residual / self._scale(field, cancelling) if residual > round_off else 0.0
            )
            if not isfinite(residual):
                what = f"the {field} residual is not finite after {len(self.history)} iterations"
                raise ConvergenceError(what, SMALLER_STEP)
        self._require_digits(EPSILON * drag)
        self.history.append(errors)
        if max(errors.values()) > self.tolerance:
            return False
        # not of attempts that diverge, whose round-off would let the next one pass
        volume = max(self.largest.get("volume", 0.0), self._scale("volume", cancelling))
        self.largest = self._present | {"volume": volume}
        return True

    def _scale(self, field: str, cancelling: dict[str, float]) -> float:
        scale = self._scales[field]
        return min(scale, cancelling.get(field) or scale) if field == "volume" else scale

    def _require_digits(self, round_off: float) -> None:
        force = max(scale for field, scale in self._scales.items() if field != "volume")
        if round_off > BLIND * force and round_off > ROUND_OFF * self._largest_like(
            "fluid momentum"
        ):
            raise ConvergenceError(
                f"round-off of the drag, {round_off:.1e} N of {force:.1e} N, hides the balance of"
                " the fluid: the permeability is too small for double precision",
                "raise it",
            )

    def _largest_like(self, field: str) -> float:
        """Return the largest force of run and iterate in the unit of a field, or its own largest
        term.
        """
        force = max(norm for other, norm in self._present.items() if other != "volume")
        if field != "volume":
            return force
        flow = self._present.get("fluid momentum", 0.0) / self.flow_force_per_rate
        if not self.history:
            # a flow under a large pressure may be as small as that: it is solved for once before
            flow *= EPSILON / ROUND_OFF
        return max(self._present[field], force / self.force_per_rate, flow)

    @property
    def slow(self) -> bool:
        """Return whether the last two sweeps reduced the residual by less than SLOW each on
        average.
        """
        errors = [max(errors.values()) for errors in self.history[-3:]]
        return len(self.history) > WARM_UP and errors[-1] > SLOW**2 * errors[0]

    @property
    def contraction(self) -> float:
        """Return the residual over that of the iteration before, 1 on the first of a step."""
        errors = [max(errors.values()) for errors in self.history[-2:]]
        return errors[1] / errors[0] if len(errors) == 2 else 1.0

    @property
    def falling(self) -> bool:
        """Return whether the residuals of the step have fallen at all, to a tenth of the forces at
        least.
        """
        return min((max(errors.values()) for errors in self.history), default=1.0) < 0.1

    @property
    def _stalled(self) -> bool:
        """Return whether the residual is small and has not fallen in the second half of the
        iterations.
        """
        errors = [max(errors.values()) for errors in self.history]
        half = len(errors) // 2
        return half > 0 and errors[-1] < STALL and min(errors[half:]) > 0.5 * min(errors[:half])

    def failure(self, t: float, step: int, advice: str) -> ConvergenceError:
        """Return the ConvergenceError of a step that reached its cap."""
        last = self.history[-1]
        worst = max(last, key=last.__getitem__)
        if self._stalled:
            advice = (
                "it falls no further, which is round-off; raise coupling.tolerance above"
                f" {last[worst]:.0e}"
            )
        trail = ", ".join(
            f"{max(errors.values()):.1e}"
            for errors in self.history[:: max(1, len(self.history) // 8)]
        )
        return ConvergenceError(
            f"coupling did not converge at t = {t:g} s (step {step}): {len(self.history) - 1}"
            f" iterations, {worst} residual {last[worst]:.1e} > {self.tolerance:.0e} (history"
            f" {trail})",
            advice,
        )
