"""What solids and free fluids ask of the places of a scene: a surface or a probe is on one of them,
on both or between.
"""

from pathlib import Path

import numpy as np

from ..conditions import CONDITIONS
from ..config import Scene
from ..config.conditions import excluded_by, named
from ..errors import InputError
from ..mesh.check import require_tags
from ..mesh.interface import INTERFACE
from ..mesh.mesh import Mesh
from ..mesh.topology import facet_multiplicity, locate_facets
from ..quantities import SURFACES

OF_SOLIDS = ("normal_displacement", "equal_displacement")
OF_PORES = ("pressure", "velocity", "no_slip")  # beside conditions behind which are pores alone
MEANS = {"porous": "porous medium", "solid": "solid", "fluid": "fluid"}


def check_sides(scene: Scene, mesh: Mesh, kinds: dict[str, str], where: str | Path) -> None:
    """Raise InputError where a boundary asks for what its surface has not.

    kinds : region -> "solid", "fluid" or "porous", a solid that a free fluid flows through
    """
    sides = {tag: _phases(mesh, facets, kinds) for tag, facets in mesh.facets.items()}
    _check_interfaces(scene, mesh, sides, where)
    if (
        len(set(kinds.values())) > 1
        and "interface" not in set().union(*sides.values())
        and not scene.interface
    ):
        text = (
            "the regions of solid and fluid have no surface in common; give them common nodes"
            " there, or an [[interface]]"
        )
        raise InputError(f"{where} [[material]]: {text}")
    outside = facet_multiplicity(mesh.cells, mesh.element) == 1
    taken: dict[tuple[str, str], int] = {}
    between = _sides_of_interfaces(scene)
    for i, boundary in enumerate(scene.boundary):
        for tag in boundary.on:
            if tag in between:
                text = (
                    f"tag '{tag}' is a side of an interface, where solid and fluid set the"
                    " conditions; remove it"
                )
                raise InputError(f"{where} [boundary.{i}.on]: {text}")
            for quantity in boundary.given():
                place = f"{where} [boundary.{i}.{quantity}]: tag '{tag}'"
                _require_phase(quantity.partition(".")[0], sides[tag], place)
                _require_boundary(quantity, mesh, tag, outside, place)
                for other in sorted(_excluded(quantity, sides[tag])):
                    if (tag, other) in taken:
                        first = f"boundary.{taken[tag, other]}.{other}"
                        raise InputError(
                            f"{place} has {first} already, which excludes {quantity}; remove one of"
                            " the two"
                        )
                taken[tag, quantity] = i


def check_dry(scene: Scene, mesh: Mesh, kinds: dict[str, str], where: str | Path) -> None:
    """Raise InputError where solids without pores have no node in common with the porous media of a
    scene, or where a boundary of them asks for what only a pore fluid has.

    kinds : region -> "solid" or "porous"
    """
    if set(kinds.values()) == {"porous"}:
        return
    porous = np.isin(
        mesh.cell_region, [i for i, name in enumerate(mesh.regions) if kinds[name] == "porous"]
    )
    if not np.isin(mesh.cells[~porous], mesh.cells[porous]).any():
        raise InputError(
            f"{where} [[material]]: the porous media and the solids without pores have no node in"
            " common, expected a common surface; give them common nodes there, or a scene each"
        )
    for i, boundary in enumerate(scene.boundary):
        asked = [name.partition(".")[0] for name in boundary.given()]
        of_fluid = [name for name in asked if _is_of_pores(name)]
        for tag in boundary.on if of_fluid else ():
            phases = _phases(mesh, mesh.facets[tag], kinds)
            if phases != {"porous"}:
                raise InputError(
                    f"{where} [boundary.{i}.{of_fluid[0]}]: tag '{tag}' is on a solid without"
                    " pores, expected a surface of porous media alone; leave it out there, or give"
                    " each part a tag of its own"
                )


def _is_of_pores(name):
    """Return whether what a boundary prescribes is of a pore fluid alone."""
    of_fluid = name in CONDITIONS and CONDITIONS[name].behind == ("porous",)
    return of_fluid or name in OF_PORES


def _sides_of_interfaces(scene):
    """Return the tags of all [[interface]]; with them the tag that the mesh has by itself lies on
    one.
    """
    tags = {tag for pair in scene.interface for tag in (*pair.fluid, *pair.solid)}
    return tags | {INTERFACE} if tags else tags


def _check_interfaces(scene, mesh, sides, where):
    """Raise InputError where a side of an [[interface]] is no boundary of the mesh on its own
    phase.
    """
    outside = facet_multiplicity(mesh.cells, mesh.element) == 1
    for i, pair in enumerate(scene.interface):
        for kind in ("fluid", "solid"):
            for tag in getattr(pair, kind):
                place = f"{where} [interface.{i}.{kind}]: tag '{tag}'"
                if not outside[locate_facets(mesh.facets[tag], mesh.cells, mesh.element)].all():
                    raise InputError(
                        f"{place} lies inside of the mesh, expected its boundary; leave out where"
                        " nodes are common"
                    )
                if sides[tag] != {kind}:
                    raise InputError(
                        f"{place} is on {' and '.join(sorted(sides[tag]))}, expected a surface of"
                        f" the {kind} alone"
                    )


def _phases(mesh, facets, kinds):
    """Return what lies behind tagged facets (F, Af): kinds of regions and, where two of them do,
    "interface".
    """
    behind = {}
    for kind in sorted(set(kinds.values())):
        chosen = np.isin(
            mesh.cell_region, [i for i, name in enumerate(mesh.regions) if kinds[name] == kind]
        )
        behind[kind] = locate_facets(facets, mesh.cells[chosen], mesh.element)[0] >= 0
    between = sum(here.astype(int) for here in behind.values()) > 1
    found = {kind for kind, here in behind.items() if (here & ~between).any()}
    return found | ({"interface"} if between.any() else set())


def _require_phase(name, phases, place):
    """Raise InputError where no phase on the surface has the quantity, or where two would take the
    same load.
    """
    if "interface" in phases:
        raise InputError(
            f"{place} lies between solid and fluid, which set the conditions there; remove it"
        )
    if name == "velocity" and phases == {"solid"}:
        raise InputError(
            f"{place} is on the solid, expected a surface of the fluid; prescribe a displacement"
            " instead"
        )
    if name == "inflow" and phases != {"fluid"}:
        raise InputError(
            f"{place} is on the {' and the '.join(sorted(phases))}, expected a surface of a free"
            " fluid alone"
        )
    if name in OF_SOLIDS and "fluid" in phases:
        raise InputError(
            f"{place} is on the fluid, expected a surface of the solid; prescribe components of"
            " `displacement` where the mesh of the fluid is to move"
        )
    if name in CONDITIONS:
        _require_behind(CONDITIONS[name], phases, place)


def _require_boundary(quantity, mesh, tag, outside, place):
    """Raise InputError where a condition of a fluid alone, an outlet, is inside of the mesh."""
    of_fluid = quantity in CONDITIONS and CONDITIONS[quantity].behind == ("fluid",)
    if not of_fluid and quantity != "inflow":
        return
    if not outside[locate_facets(mesh.facets[tag], mesh.cells, mesh.element)].all():
        raise InputError(f"{place} lies inside of the mesh, expected its boundary; remove it")


def _require_behind(condition, phases, place):
    """Raise InputError where a condition has another material behind it, or several."""
    if len(phases) > 1:
        text = "expected a surface of one of them; give each part a tag of its own"
        raise InputError(f"{place} is on {' and '.join(sorted(phases))}, {text}")
    if phases - set(condition.behind):
        raise InputError(
            f"{place} is on the {min(phases)}, expected a surface of a {named(condition)};"
            f" {condition.otherwise}"
        )
    if phases == {"porous"}:
        raise InputError(
            f"{place} is on a porous solid beside a free fluid, where loads are not divided; leave"
            " it out"
        )


def _excluded(quantity, phases):
    """Return what may not stand beside a quantity, itself included: on a fluid `displacement` is
    that of the mesh.
    """
    return {quantity}.union(*(excluded_by(quantity, kind) for kind in phases - {"interface"}))


def check_surfaces(scene: Scene, mesh: Mesh, kinds: dict[str, str], where: str | Path) -> None:
    """Raise InputError where a [[force]] or [[surface]] is on two phases, inside of one, or
    asks for what is not theirs.

    kinds : region -> "solid", "fluid" or "porous"
    """
    outside = facet_multiplicity(mesh.cells, mesh.element) == 1
    of_solid = {tag for pair in scene.interface for tag in pair.solid}
    for key, entry in scene.named_surfaces:
        place = f"{where} [{key}.on]"
        require_tags(mesh, entry.on, place)
        sides = {tag: _phases(mesh, mesh.facets[tag], kinds) for tag in entry.on}
        for tag in entry.on:
            if tag in of_solid:
                text = (
                    "is on the solid's side of an interface, expected the fluid's, whose force"
                    " it is"
                )
                raise InputError(f"{place}: tag '{tag}' {text}")
            _require_outside(mesh, tag, sides[tag], outside, scene.is_porous, place)
        dry = [tag for tag in entry.on if sides[tag] == {"solid"}]
        if 0 < len(dry) < len(entry.on) and not scene.is_porous:
            wet = next(tag for tag in entry.on if tag not in dry)
            text = f"received '{dry[0]}' on the solid and '{wet}' on the fluid"
            table = key.partition(".")[0]
            raise InputError(
                f"{place}: {text}, expected surfaces of one of them; give each a [[{table}]]"
            )
        _require_quantities(scene, entry, set().union(*sides.values()), f"{where} [{key}")


def _require_outside(mesh, tag, phases, outside, porous, place):
    """Raise InputError where a tag is inside of a phase: what one side of it feels, the other gives
    back.

    porous : whether there is no free fluid
    """
    inside = ~outside[locate_facets(mesh.facets[tag], mesh.cells, mesh.element)]
    if inside.any() and (porous or "interface" not in phases):
        raise InputError(
            f"{place}: tag '{tag}' lies inside of the mesh, expected its boundary or that between"
            " a free fluid and a solid"
        )


def _require_quantities(scene, entry, phases, place):
    """Raise InputError where what is behind a surface has not what is asked for."""
    porous = scene.is_porous and phases != {"solid"}
    kind = "porous" if porous else "solid" if phases == {"solid"} else "fluid"
    for name in entry.quantities:
        if porous and "solid" in phases and name != "force":
            raise InputError(
                f"{place}.quantities]: received '{name}' on porous media and solids without pores"
                " together, expected 'force', or surfaces of one of them"
            )
        if kind not in SURFACES[name].behind:
            fitting = [q for q in SURFACES if kind in SURFACES[q].behind]
            raise InputError(
                f"{place}.quantities]: received '{name}' on '{entry.on[0]}', behind which is the"
                f" {MEANS[kind]}, expected one of {', '.join(fitting)}"
            )
        if name in ("flow_rate", "volume") and {"interface", "porous"} <= phases:
            raise InputError(
                f"{place}.quantities]: received '{name}' between fluid and porous solid, expected"
                " surfaces of the boundary"
            )
