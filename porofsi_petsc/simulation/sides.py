"""What solids and free fluids ask of the surfaces of a scene: each lies on the solid, on the fluid, on both or between them."""

import numpy as np

from ..errors import InputError
from ..mesh.check import require_tags
from ..mesh.topology import locate_facets


def check_sides(scene, mesh, kinds, where):
    """Raise InputError where a boundary or a force asks for what its surface has not.

    kinds : region -> "solid", "fluid" or "porous", a solid that a free fluid flows through
    """
    sides = {tag: _phases(mesh, facets, kinds) for tag, facets in mesh.facets.items()}
    if len(set(kinds.values())) > 1 and "interface" not in set().union(*sides.values()):
        text = "the regions of solid and fluid have no surface in common; give them common nodes there"
        raise InputError(f"{where} [[material]]: {text}")
    taken = {}
    for i, boundary in enumerate(scene.boundary):
        for tag in boundary.on:
            for quantity in boundary.given():
                place = f"{where} [boundary.{i}.{quantity}]: tag '{tag}'"
                _require_phase(quantity.partition(".")[0], sides[tag], place)
                for other in _excluded_by(quantity, sides[tag]):
                    if (tag, other) in taken:
                        first = f"boundary.{taken[tag, other]}.{other}"
                        raise InputError(f"{place} has {first} already, which excludes {quantity}; remove one of the two")
                taken[tag, quantity] = i
    _check_forces(scene, mesh, sides, where)


def _phases(mesh, facets, kinds):
    """Return what lies behind tagged facets (F, Af): kinds of regions and, where two of them do, "interface"."""
    behind = {}
    for kind in sorted(set(kinds.values())):
        chosen = np.isin(mesh.cell_region, [i for i, name in enumerate(mesh.regions) if kinds[name] == kind])
        behind[kind] = locate_facets(facets, mesh.cells[chosen], mesh.element)[0] >= 0
    between = sum(here.astype(int) for here in behind.values()) > 1
    found = {kind for kind, here in behind.items() if (here & ~between).any()}
    return found | ({"interface"} if between.any() else set())


def _require_phase(name, phases, place):
    """Raise InputError where no phase on the surface has the quantity, or where two would take the same load."""
    if "interface" in phases:
        raise InputError(f"{place} lies between solid and fluid, which set the conditions there; remove it")
    if name == "velocity" and phases == {"solid"}:
        raise InputError(f"{place} is on the solid, expected a surface of the fluid; prescribe a displacement instead")
    if name == "traction" and len(phases) > 1:
        text = "expected a surface of one of them; give each part a tag of its own"
        raise InputError(f"{place} is on {' and '.join(sorted(phases))}, {text}")
    if name == "traction" and phases == {"porous"}:
        raise InputError(f"{place} is on a porous solid beside a free fluid, where loads are not divided; leave it out")


def _excluded_by(quantity, phases):
    """Return what may not stand beside a quantity, itself included: on a fluid `displacement` is that of the mesh."""
    name, _, component = quantity.partition(".")
    essential = "velocity" if "fluid" in phases else "displacement"
    return {
        "displacement": [quantity] + [f"traction.{component}"] * (essential == "displacement"),
        "velocity": [quantity, f"traction.{component}"],
        "traction": [quantity, f"{essential}.{component}"],
    }[name]


def _check_forces(scene, mesh, sides, where):
    for i, force in enumerate(scene.force):
        place = f"{where} [force.{i}.on]"
        require_tags(mesh, force.on, place)
        for tag in force.on:
            if sides[tag] == {"solid"}:
                raise InputError(f"{place}: tag '{tag}' is on the solid, expected a surface of the fluid, whose force it is")
