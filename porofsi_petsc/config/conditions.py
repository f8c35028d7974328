"""Entries [[boundary]], [body_force] and [initial]: what is prescribed, where, and what excludes
what.
"""

from collections.abc import Sequence
from typing import Annotated

from pydantic import Field, Strict

from ..errors import shown
from .types import Flag, Formula, Number, Table, Tags, Vector, wrong

VECTORS = ("displacement", "velocity", "traction")


class Boundary(Table):
    """Conditions on tagged surfaces; what is absent is free, and impermeable (v_f.n = v_s.n).

    displacement [m], velocity of the fluid phase [m/s], traction of the mixture per reference area
    [Pa], pressure [Pa], outward seepage flux n_f w.n [m/s]; no_slip: v_f = v_s in all components;
    backflow: part of the kinetic energy that convection carries in through an open boundary of a
    free fluid which a traction takes away again; priority: which entry holds at a node of several.
    """

    on: Tags
    displacement: Vector = Vector()
    velocity: Vector = Vector()
    traction: Vector = Vector()
    pressure: Formula | None = None
    flux: Formula | None = None
    no_slip: Flag = False
    backflow: Number = Field(default=0.0, ge=0)
    priority: Annotated[int, Strict()] = 0

    def given(self) -> list[str]:
        """Return the names of what this entry prescribes, such as 'displacement.x' and
        'pressure'.
        """
        names = [
            f"{name}.{c}"
            for name in VECTORS
            for c in "xyz"
            if getattr(getattr(self, name), c) is not None
        ]
        names += [name for name in ("pressure", "flux") if getattr(self, name) is not None]
        return names + ["no_slip"] * self.no_slip + ["backflow"] * (self.backflow > 0)


class BodyForce(Table):
    """Acceleration b [m/s^2] that acts on each phase, times its partial density."""

    solid: Vector = Vector()
    fluid: Vector = Vector()


class Initial(Table):
    """State at t = 0: displacement [m], velocities [m/s] and pressure [Pa]; zero where absent."""

    displacement: Vector = Vector()
    solid_velocity: Vector = Vector()
    fluid_velocity: Vector = Vector()
    pressure: Formula | None = None


def check_boundaries(boundaries: Sequence[Boundary], brinkman: bool, porous: bool) -> None:
    """Refuse a quantity prescribed twice on a tag, or beside one that excludes it.

    Without porous materials the phase behind a surface decides what excludes what; see
    `simulation.sides`.
    """
    taken: dict[tuple[str, str], int] = {}
    for i, boundary in enumerate(boundaries):
        if boundary.no_slip and not brinkman:
            raise wrong(
                "received true, expected false without model.viscosity = true (Darcy)",
                f"boundary.{i}.no_slip",
            )
        if boundary.backflow and porous:
            text = "with porous materials, expected an open boundary of a free fluid; leave it out"
            raise wrong(f"received {boundary.backflow:g} {text}", f"boundary.{i}.backflow")
        for tag in boundary.on:
            for quantity in boundary.given():
                for other in (quantity, *(_excluded_by(quantity) if porous else ())):
                    if (tag, other) in taken:
                        first = f"boundary.{taken[tag, other]}.{other}"
                        text = (
                            f"tag '{tag}' has {first} already, which excludes {quantity}; remove"
                            " one of the two"
                        )
                        raise wrong(text, f"boundary.{i}.{quantity}")
                taken[tag, quantity] = i


def _excluded_by(quantity: str) -> list[str]:
    name, _, component = quantity.partition(".")
    return {
        "displacement": [f"traction.{component}"],
        "traction": [f"displacement.{component}"],
        "velocity": ["no_slip"],
        "no_slip": ["velocity.x", "velocity.y", "velocity.z", "pressure", "flux"],
        "pressure": ["flux", "no_slip"],
        "flux": ["pressure", "no_slip"],
    }[name]


def check_expressions(section: Table, dim: int, key: str, position_only: bool = False) -> None:
    """Refuse components and variables beyond the dimension, and t where only the position is known;
    tell each its key.
    """
    for name in type(section).model_fields:
        value = getattr(section, name)
        if isinstance(value, Vector):
            if dim == 2 and value.z is not None:
                raise wrong(
                    "received a component in a two-dimensional scene, expected only x and y",
                    f"{key}.{name}.z",
                )
            check_expressions(value, dim, f"{key}.{name}", position_only)
        elif hasattr(value, "names"):
            value.key = f"{key}.{name}"
            if dim == 2 and "z" in value.names:
                raise wrong(
                    f"received {shown(value.source)} in a two-dimensional scene, expected no z",
                    f"{key}.{name}",
                )
            if (
                position_only and value.depends_on_time and value.function is None
            ):  # a function gets t = 0
                raise wrong(
                    f"received {shown(value.source)}, expected a function of position only",
                    f"{key}.{name}",
                )
