"""Energy balance of a run: what the loads did, where it is, and what dissipated it.

With the residuals of both phases tested by their collocated velocities and pressure, every
converged step satisfies

    P_external = P_inertia + P_stress + P_storage + D_drag + D_viscous + D_stabilization

(pressure and volume balance cancel)

to solver tolerance.  The time scheme's own dissipation is Δt (P_inertia + P_stress) - Δ(kinetic +
elastic energy); with finite strain it holds the transport of fluid through the boundary as well.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from ..phases.residual import Residual


@dataclass
class Energy:
    """Sums since the start and present energies [J, in 2-D per metre of thickness, around an axis
    of the whole body].
    """

    external_work: float = 0.0
    kinetic: float = 0.0
    elastic: float = 0.0
    drag_dissipation: float = 0.0
    viscous_dissipation: float = 0.0
    stabilization_dissipation: float = 0.0
    time_scheme_dissipation: float = 0.0
    initial: float = 0.0
    largest_work: float = 0.0

    def start(self, kinetic: float, elastic: float) -> None:
        """Set the energies of the initial state."""
        self.kinetic = kinetic
        self.elastic = elastic
        self.initial = kinetic + elastic

    def remodel(self, kinetic: float, elastic: float) -> None:
        """Go on with the energies of another [model] of the same state; the difference counts as
        given at the start.
        """
        self.initial += kinetic + elastic - self.kinetic - self.elastic
        self.kinetic = kinetic
        self.elastic = elastic

    def add_step(
        self, dt: float, powers: Mapping[str, float], kinetic: float, elastic: float
    ) -> None:
        """Add an accepted step: powers as `step_powers` gives them, energies at its end."""
        stored = dt * powers["stored"]
        self.external_work += dt * powers["external"]
        self.drag_dissipation += dt * powers["drag"]
        self.viscous_dissipation += dt * powers["viscous"]
        self.stabilization_dissipation += dt * powers["stabilization"]
        self.time_scheme_dissipation += stored - (kinetic + elastic - self.kinetic - self.elastic)
        self.kinetic = kinetic
        self.elastic = elastic
        self.largest_work = max(self.largest_work, abs(self.external_work))

    @property
    def balance_error(self) -> float:
        """Return external work minus change of energy minus all dissipations [J]."""
        dissipated = (
            self.drag_dissipation
            + self.viscous_dissipation
            + self.stabilization_dissipation
            + self.time_scheme_dissipation
        )
        return self.external_work - (self.kinetic + self.elastic - self.initial) - dissipated

    @property
    def scale(self) -> float:
        """Return the energy [J] that others are compared with: the largest work, or what there is
        or was of energy.
        """
        return max(self.largest_work, abs(self.initial), self.kinetic + self.elastic)

    @property
    def stabilization_share(self) -> float:
        """Return the dissipation of the stabilization over `scale`."""
        return self.stabilization_dissipation / self.scale if self.scale else 0.0

    def report(self) -> dict[str, float]:
        """Return the entries of the summary."""
        names = [
            "external_work",
            "kinetic",
            "elastic",
            "drag_dissipation",
            "viscous_dissipation",
            "stabilization_dissipation",
            "time_scheme_dissipation",
        ]
        errors = {
            "balance_error": self.balance_error,
            "balance_error_relative": abs(self.balance_error) / self.scale if self.scale else 0.0,
            "stabilization_share": self.stabilization_share,
        }
        return {name: getattr(self, name) for name in names} | errors

    def state(self) -> dict[str, float]:
        """Return the numbers a restart needs."""
        return asdict(self)

    def load(self, state: dict[str, float]) -> None:
        """Continue from `state`."""
        vars(self).update(state)


def step_powers(
    solid_residual: Residual,
    fluid_residuals: tuple[Residual, Residual],
    v_s: np.ndarray,
    v_f: np.ndarray,
    p: np.ndarray,
) -> dict[str, float]:
    """Return the powers of a converged step [W]; v_s, v_f (n_owned, d), p (n_owned, 1) on the
    collocation level (collective).

    The power of what holds prescribed values (reactions) belongs to the external one.
    """
    momentum, volume = fluid_residuals
    solid = solid_residual.power(v_s)
    fluid = momentum.power(v_f)
    mass = volume.power(p)
    reactions = (
        solid_residual.reaction_power(v_s) + momentum.reaction_power(v_f) + volume.reaction_power(p)
    )
    external = (
        reactions
        - solid["traction"]
        - solid["body"]
        - fluid["body"]
        - fluid["traction"]
        - mass.get("flux", 0.0)
    )
    external -= solid.get("interface", 0.0)  # what the fluid does there is among the reactions
    return {
        "external": external,
        "stored": solid["stress"]
        + solid.get("inertia", 0.0)
        + fluid["inertia"]
        + mass.get("storage", 0.0),
        "drag": solid.get("drag", 0.0) + fluid["drag"],
        "viscous": fluid["viscous"],
        "stabilization": fluid["stabilization"] + mass["pspg"] + mass["undrained"],
    }
