"""What closes a free fluid: boundaries of known velocity, whose data must balance, or a solid, for
which the scheme is chosen.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..config import Scene
from ..errors import InputError
from ..fem.closed import ClosedPart, closed_nodes
from ..fem.domain import Domain
from ..fem.essential import Dirichlet, Essential
from .builder import MONOLITHIC
from .conditions import sample_times


def closed_parts(
    scene: Scene,
    domain: Domain,
    velocity: Dirichlet,
    entries: Sequence[Essential],
    held: np.ndarray,
) -> tuple[ClosedPart, ...]:
    """Return the `fem.closed.ClosedPart`s of a fluid (collective); raise IncompatibleData where its
    data have a net flux.

    velocity, entries : the `Dirichlet` of the fluid and what it was made of; held : (n_local, d)
    bool, where it sticks to a solid whose motion is prescribed
    """
    where = str(scene.source_path or "scene")
    found = closed_nodes(domain, velocity.mask | held)
    parts = tuple(ClosedPart(domain, nodes, velocity, entries, where) for nodes in found)
    if not scene.model.moving_mesh:
        for t in sample_times(scene.time):
            for part in parts:
                part.require_balanced_data(t)
    return parts


class InterfaceScheme(NamedTuple):
    """A `coupling.scheme`, the conditions of its interface, and what a run says of the choice."""

    scheme: str
    pair: str
    notices: tuple = ()


def interface_scheme(scene: Scene, closed_by_solid: bool, direct: bool) -> InterfaceScheme:
    """Return the `InterfaceScheme` of a scene; raise InputError where what it asks for leaves the
    pressure no level.

    closed_by_solid : whether a part of the fluid is closed when the velocity of the interface is
    known.  Told it all around, the fluid cannot keep its volume, and no force tells the solid how
    much room to make: schemes that solve for both, or tell the fluid a combination of velocity and
    force, do.  direct : whether a mesh of this size is solved by factorizations
    """
    choice = scene.coupling
    driven = choice.scheme not in MONOLITHIC and choice.interface in ("auto", "dirichlet_neumann")
    pair = "dirichlet_neumann" if driven or choice.scheme in MONOLITHIC else choice.interface
    if not closed_by_solid or not driven:
        return InterfaceScheme(choice.scheme, pair)
    _require_free_choice(scene)
    robin = not direct and scene.time.scheme == "generalized_alpha" and scene.model.solid_inertia
    chosen = (
        InterfaceScheme("partitioned", "robin_neumann")
        if robin
        else InterfaceScheme("direct", pair)
    )
    key = 'coupling.interface = "robin_neumann"' if robin else 'coupling.scheme = "direct"'
    return chosen._replace(
        notices=(
            (
                f"the solid closes the fluid: {key}, because told its velocity all around the fluid"
                " has no level"
            ),
        )
    )


def _require_free_choice(scene):
    """Raise InputError where a fluid that the solid closes would be told its velocity because the
    scene wants it so.
    """
    choice = scene.coupling
    where = scene.source_path or "scene"
    why = (
        "with a fluid that the solid closes: told its velocity all around, its pressure has no"
        " level"
    )
    for key, value, free in (
        ("scheme", choice.scheme, "partitioned"),
        ("interface", choice.interface, "auto"),
    ):
        if value != free:
            advice = (
                "leave it out, or take coupling.scheme = 'direct' or coupling.interface ="
                " 'robin_neumann'"
            )
            raise InputError(f"{where} [coupling.{key}]: received '{value}' {why}; {advice}")
