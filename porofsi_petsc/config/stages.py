"""[[stage]]: what changes in the stages of a run, and the complete scene of each of them."""

from collections.abc import Collection, Iterable
from typing import Annotated, Any, TypeVar

from pydantic import ValidationError

from ..conditions import CONDITIONS
from ..errors import digits, shown
from .conditions import BodyForces, Boundary, Tie, WithConditions
from .material import Material
from .messages import text_of
from .sections import Load
from .types import ListOf, Name, Table, wrong

S = TypeVar("S", bound=Any)  # a Scene
SETTINGS = ("time", "model", "coupling")  # tables of which a stage gives the keys that change
CHANGES = ("inactive", "active")  # of what is there
REPLACED = ("body_force", "load", "tie")  # sections that a stage gives as a whole


class Stage(Table):
    """What changes when the stage before is at its end; what is absent stays as it is there.

    time : its end on the clock of the run, and its own steps; boundary : all that holds on the tags
    named, material : of the regions named; inactive : regions that are taken away; active : regions
    that are placed; gradual : all of this comes over the duration of the stage, not at once;
    reset_displacement : report it from the start of the stage on
    """

    name: Name
    time: dict[str, Any]
    boundary: Annotated[tuple[Annotated[Boundary, WithConditions()], ...], ListOf()] = ()
    material: Annotated[tuple[Material, ...], ListOf()] = ()
    body_force: BodyForces | None = None
    load: Annotated[tuple[Load, ...], ListOf()] | None = None
    tie: Annotated[tuple[Tie, ...], ListOf()] | None = None
    model: dict[str, Any] | None = None
    coupling: dict[str, Any] | None = None
    inactive: Annotated[tuple[Name, ...], ListOf()] = ()
    active: Annotated[tuple[Name, ...], ListOf()] = ()
    gradual: bool = False
    reset_displacement: bool = False


def absent_at_start(
    changes: Iterable[tuple[Collection[str], Collection[str]]],
) -> tuple[str, ...]:
    """Return the regions that a stage places before one takes them away.

    changes : the regions that are taken away and those that are placed, of the stages in turn
    """
    present: set[str] = set()
    absent: list[str] = []
    for inactive, active in changes:
        absent += [name for name in active if name not in {*present, *absent}]
        present |= {*inactive}
    return tuple(absent)


def following(before: S, stage: Stage, number: int) -> S:
    """Return the complete scene of a stage after that of the one before; raises the error of the
    first mistake, whose key is that of the stage.
    """
    place = f"stage.{number}"
    _require_comparable(before, stage, place)
    tables = {name: getattr(before, name) for name in type(before).model_fields if name != "stage"}
    boundaries = _remaining(before.boundary, "on", stage.boundary)
    materials = _remaining(before.material, "region", stage.material)
    tables["boundary"] = (*boundaries, *stage.boundary)
    tables["material"] = (*materials, *stage.material)
    for name in SETTINGS:
        if changes := getattr(stage, name):
            tables[name] = getattr(before, name).model_dump(exclude_unset=True) | changes
    for name in REPLACED:
        if getattr(stage, name) is not None:
            tables[name] = getattr(stage, name)
    kept = {"boundary": len(boundaries), "material": len(materials)}
    try:
        scene = type(before).model_validate(tables)
    except ValidationError as error:
        raise _in_stage(error, kept, place) from None
    _require_continued(before, scene, place)
    if stage.gradual and scene.model.solid_inertia:
        text = "received true with inertia of the solid, which answers at once, expected a model"
        raise wrong(f"{text} with solid_inertia = false; leave it out", f"{place}.gradual")
    scene.time._begins = before.time.end
    left = (name for name in before.inactive if name not in stage.active)
    scene._inactive = (*left, *stage.inactive)
    scene._placed = (*before.placed, *stage.active)
    scene._changing = before.changing
    scene._gradual = stage.gradual
    scene._source_path = before.source_path
    return scene


def _remaining(entries, key, new):
    """Return the entries without the tags or regions that new ones name."""
    named = {word for entry in new for word in getattr(entry, key)}
    found = []
    for entry in entries:
        words = tuple(word for word in getattr(entry, key) if word not in named)
        if words and "all" not in named:
            found.append(entry.model_copy(update={key: words}))
    return found


def _require_comparable(before, stage, place):
    """Refuse what a stage cannot take over."""
    for name, text in (
        ("reference", "whose exact solution knows one stage"),
        ("precice", "whose coupling knows one stage"),
    ):
        if getattr(before, name) is not None:
            raise wrong(f"received one beside [{name}], {text}; leave one of the two out", place)
    for key in ("scheme", "consistent_start"):
        if key in stage.time:
            text = "expected that of the first stage, with whose state it goes on; leave it out"
            raise wrong(f"received {shown(stage.time[key])}, {text}", f"{place}.time.{key}")
    _require_solids(before, stage, place)
    _require_changes(before, stage, place)
    if "end" not in stage.time:
        raise wrong("received nothing, expected the end of the stage [s]", f"{place}.time.end")
    for i, boundary in enumerate(stage.boundary):
        for name in boundary.surface_conditions():
            if CONDITIONS[name].columns:
                text = "received a condition that has a state, expected it in the first stage"
                raise wrong(f"{text}; leave the tag out, then it stays", f"{place}.boundary.{i}")
    for i, material in enumerate(stage.material):
        _require_known_material(before, material, stage.active, f"{place}.material.{i}")


def _require_solids(before, stage, place):
    """Refuse what only a solid or skeleton can do, where there is none, and twice the same."""
    if stage.reset_displacement and not before.phases[0]:
        text = "received true without a solid, which alone has displacements; leave it out"
        raise wrong(text, f"{place}.reset_displacement")
    kinds = {material.kind for material in before.material}
    for key in (*CHANGES, "gradual"):
        names = getattr(stage, key)
        if names and "fluid" in kinds:
            received = names if names is True else list(names)
            text = "expected a scene without a free fluid; leave it out"
            raise wrong(f"received {shown(received)}, {text}", f"{place}.{key}")


def _require_changes(before, stage, place):
    """Refuse to take away what is not there, to place what is, and both or one of them twice."""
    for i, name in enumerate(stage.inactive):
        if name in (*before.inactive, *stage.inactive[:i]):
            text = "which is taken away already, expected other regions; leave it out"
            raise wrong(f"received '{name}', {text}", f"{place}.inactive")
    for i, name in enumerate(stage.active):
        if name not in before.inactive or name in (*stage.inactive, *stage.active[:i]):
            text = "which is there already, expected regions that are not; leave it out"
            raise wrong(f"received '{name}', {text}", f"{place}.active")
    if stage.active and before.tie:
        text = "received regions to place beside [[tie]], whose sides know one position at rest"
        raise wrong(f"{text}; let the mesh of both sides share its nodes", f"{place}.active")


def _require_known_material(before, material, placed, key):
    """Refuse another kind of material and a law with a memory, but in regions that are placed, and
    regions without entries of their own.
    """
    named = set(material.region)
    known = {word for entry in before.material for word in entry.region}
    if named != {"all"} and "all" in known:
        text = "expected region = 'all' as in the stage before; name the regions there"
        raise wrong(f"received {shown(list(material.region))}, {text}", f"{key}.region")
    named -= set(placed)
    for old in before.material:
        if named != {"all"} and not named & set(old.region):
            continue
        if old.kind != material.kind:
            text = f"received a {material.kind}, expected a {old.kind} as in the stage before"
            raise wrong(text, key)
        if any(entry.solid and entry.elastic_law().memory for entry in (old, material)):
            text = (
                "received another material where a law has internal variables, expected the one of"
                " the stage before; leave it out"
            )
            raise wrong(text, key)


def _require_continued(before, scene, place):
    """Refuse an end that is no later one, and other columns of the history."""
    end = before.time.end
    if scene.time.end <= end:
        raise wrong(
            f"received {digits(scene.time.end)} s, expected a time after the end of the stage"
            f" before, {digits(end)} s",
            f"{place}.time.end",
        )
    if scene.is_porous != before.is_porous:
        text = "received porous media in a scene of solids, or none in one of porous media"
        raise wrong(f"{text}, expected both or neither in all stages", f"{place}.material")
    if scene.columns != before.columns:
        lost = sorted(set(before.columns) ^ set(scene.columns))[0]
        text = "expected the same columns of the history in all stages"
        raise wrong(f"received boundaries that change {shown(lost)}, {text}", f"{place}.boundary")


def _in_stage(error, kept, place):
    """Return the first error of a scene as one of the stage that made it.

    kept : section -> number of its entries that are those of the stage before
    """
    entry = error.errors(include_url=False)[0]
    parts = [*entry["loc"], *str(entry.get("ctx", {}).get("key", "")).split(".")]
    parts = [str(part) for part in parts if part != ""]
    if len(parts) > 1 and parts[0] in kept and parts[1].isdecimal():
        parts[1] = str(int(parts[1]) - kept[parts[0]])
        if int(parts[1]) < 0:  # an entry that stays
            parts = parts[:1]
    return wrong(text_of(entry), ".".join([place, *parts]))
