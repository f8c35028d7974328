"""The essential conditions of a scene: which values hold where, and at which times they are looked
at before a run.
"""

from collections.abc import Callable, Collection, Sequence

import numpy as np

from ..config import Expression, Scene
from ..config.sections import Time
from ..config.types import Vector
from ..fem.constraints import Equal, NormalValue, Tie
from ..fem.distribute import LocalMesh
from ..fem.essential import Dirichlet, Essential
from .axis import on_axis

AXES = "xyz"
AT_ONCE = 1e-15  # 0+, in first steps: a ramp, even one like √t, has not begun
# in first steps: the distance of the points from which a rate is extrapolated, far below what a
# step resolves
RATE = 1e-5
ROUND_OFF = 1e-14  # of a value that a formula gives, some tens of units in the last place
# times of a run at which values on common nodes are compared before it starts; every step compares
# its own
SAMPLES = 16


def components(vector: Vector) -> dict[int, Expression]:
    """Return dict component -> expression of the given components of a `config.Vector`."""
    return {
        i: getattr(vector, axis) for i, axis in enumerate(AXES) if getattr(vector, axis) is not None
    }


def essentials(scene: Scene, quantity: str, tags: Collection[str] | None = None) -> list[Essential]:
    """Return the `Essential`s of displacement, velocity or pressure, on the tags if some are given.

    On a node that several share, the highest `priority` holds; at the same one a wall, a velocity
    of zero, before others.
    """
    found = []
    for i, boundary in enumerate(scene.boundary):
        value = getattr(boundary, quantity)
        given = {0: value} if quantity == "pressure" else components(value)
        for component, expression in given.items():
            key = f"boundary.{i}.{quantity}" + (
                "" if quantity == "pressure" else f".{AXES[component]}"
            )
            wall = quantity == "velocity" and expression is not None and is_zero(expression)
            for tag in boundary.on if expression is not None else ():
                if tags is None or tag in tags:
                    found.append(
                        Essential(tag, component, expression, 2 * boundary.priority + wall, key)
                    )
    return found


def linear_constraints(
    scene: Scene, tags: Collection[str] | None = None
) -> list[NormalValue | Equal | Tie]:
    """Return what a scene prescribes of the displacement beside components, on the tags if some are
    given.
    """
    found: list[NormalValue | Equal | Tie] = []
    for i, boundary in enumerate(scene.boundary):
        on = tuple(tag for tag in boundary.on if tags is None or tag in tags)
        key = f"boundary.{i}"
        if on and boundary.normal_displacement is not None:
            name = f"{key}.normal_displacement"
            found.append(NormalValue(on, boundary.normal_displacement, name))
        if on and boundary.equal_displacement:
            axes = tuple(map(AXES.index, boundary.equal_displacement))
            found.append(Equal(on, axes, f"{key}.equal_displacement"))
    for i, tie in enumerate(scene.tie):
        found.append(Tie(tie.first, tie.second, tie.axes(scene.dim), f"tie.{i}"))
    return found


def is_zero(expression: Expression) -> bool:
    """Return whether an expression is the number 0."""
    return expression.is_constant and not expression(0.0, np.zeros((1, 3))).any()


def dirichlet(
    scene: Scene, mesh: LocalMesh, components: int, given: Sequence[Essential]
) -> Dirichlet:
    """Return the `Dirichlet` of some `Essential`s of a scene, and of the axis of one around it,
    which are compared at `sample_times` (collective).
    """
    held = [*given, *(on_axis(mesh) if components == mesh.dim else [])]
    return Dirichlet(mesh, components, held, sample_times(scene.time), scene.source_path or "scene")


def sample_times(section: Time) -> list[float]:
    """Return times that stand for a whole run [s]: 0+, the first step, and SAMPLES parts of the
    rest.
    """
    return [
        at_once(section),
        section.begins + section.step,
        *np.linspace(section.begins, section.end, SAMPLES + 1)[1:].tolist(),
    ]


def at_once(section: Time) -> float:
    """Return a time that stands for 0+ [s]: after `where(t > 0, …)` switches, before anything else
    has changed.
    """
    begins = section.begins
    return max(begins + AT_ONCE * section.step, float(np.nextafter(begins, np.inf)))


def just_after(t: float, section: Time) -> float:
    """Return the first of the times from which `rate_after` takes a rate [s]."""
    return t + RATE * section.step


def rate_after(
    values: Callable[[float], np.ndarray], t: float, section: Time
) -> tuple[np.ndarray, np.ndarray]:
    """Return the right-hand derivative at t of values(t) -> (n,), and a bound of its error, (n,)
    each.

    Quotients q₁, q₂ over (t + δ, t + 2δ, t + 3δ) are those at 3/2 δ and 5/2 δ but for O(δ²), hence
    f'(t+) = q₁ - 3/2 (q₂ - q₁) + O(δ²).  Twice the correction bounds the error of a start like
    t^{3/2} too.
    """
    delta = RATE * section.step
    first, second, third = (values(t + n * delta) for n in (1, 2, 3))
    quotient = (second - first) / delta
    correction = 1.5 * (third - 2 * second + first) / delta
    return quotient - correction, 2 * np.abs(correction) + ROUND_OFF * np.abs(second) / delta


def nodes_of(mesh: LocalMesh, tags: Collection[str]) -> np.ndarray:
    """Return the nodes of tagged surfaces, (n_local,) bool with ghosts (collective)."""
    mask = np.zeros(mesh.n_local, dtype=np.uint8)
    for tag in tags:
        mask[mesh.facets[tag].nodes] = 1
    mesh.halo.update(mask)
    return mask.astype(bool)


def no_slip_nodes(scene: Scene, mesh: LocalMesh) -> np.ndarray:
    """Return the nodes with v_f = v_s, (n_local,) bool: not where a velocity of higher priority
    holds (collective).
    """
    walls = [(b.priority, tag) for b in scene.boundary if b.no_slip for tag in b.on]
    held = [(b.priority, tag) for b in scene.boundary if components(b.velocity) for tag in b.on]
    mask = np.zeros(mesh.n_local, dtype=bool)
    for priority, wall in walls:
        mask |= nodes_of(mesh, [wall]) & ~nodes_of(
            mesh, [tag for higher, tag in held if higher > priority]
        )
    return mask


def nodal_field(mesh: LocalMesh, vector: Vector) -> np.ndarray:
    """Return the nodal values of a `config.Vector` at t = 0, (n_local, d); zero where a component
    is absent.
    """
    field = np.zeros((mesh.n_local, mesh.dim))
    for component, expression in components(vector).items():
        field[:, component] = expression(0.0, mesh.X)
    return field
