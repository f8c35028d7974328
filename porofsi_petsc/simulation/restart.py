"""Continue from a checkpoint, on any number of ranks; what may have changed in the scene and what
not.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np

from ..config import Scene, comparable, table_contents
from ..config.stages import CHANGES, absent_at_start
from ..errors import InputError, shown
from ..fem.distribute import LocalMesh
from ..log import logger
from ..output.checkpoint import damaged, read_arrays
from ..output.files import parse_toml
from .auto import AnyMedium
from .energy import Energy
from .header import mistake
from .loop import TimeLoop
from .measures import Measures

# Sections that decide the state itself; time, output, solver and coupling settings may change.
FIXED = ("model", "material", "boundary", "body_force", "load", "stabilization", "interface")
# Of [reference]: errors before and after belong together.
COMPARED = ("solution", "load", "length", "frequency", "strain", "speed", "surface")

PLACED = "placed.cell_u"  # array of what stages have placed

LIKE = re.compile(
    r"^(?:\w+\.tangent_(?:skeleton_)?|step_control\.)([a-z])(?:\.\d+)?$"
)  # names of arrays that hold a field


def resume(
    path: Path,
    header: dict[str, Any],
    scene: Scene,
    text: str,
    loop: TimeLoop,
    coupling: AnyMedium,
    energy: Energy,
    measures: Measures,
    stage: int = 0,
) -> None:
    """Load every part of a run from a checkpoint; text is the present scene as TOML (collective).

    header : of `open_checkpoint`; stage : number of the one to which it belongs, for which the
    other parts are. Raises InputError when the file belongs to another mesh or scene,
    is damaged, or lies beyond the end time.
    """
    mesh = coupling.solid.mesh
    if not header["sealed"]:
        logger.info(
            "%s has no checksum: an earlier version wrote it, and damage in it cannot be noticed",
            path,
        )
    try:
        if wrong := mistake(header):
            raise ValueError(wrong)
        _require_same_scene(path, header, scene, text)
        state = coupling.state()
        past = scene.stage[:stage]
        if any(entry.reset_displacement or entry.active for entry in past):
            state["datum.u"] = state["solid.u"]
        if mesh.placed is not None and any(entry.active for entry in past):
            state[PLACED] = mesh.placed
        _require_forces(path, header["arrays"], state)
        _require_arrays(header["arrays"], state)
        arrays = read_arrays(path, header, mesh)
        _load(path, header, arrays, scene.stages[stage], loop, coupling, energy, measures)
    except KeyError as missing:
        raise damaged(path, f"its entry {missing} is missing", mesh.comm) from missing
    except (TypeError, ValueError) as failure:
        raise damaged(path, str(failure), mesh.comm) from failure


def placed_cells(path: Path, header: dict[str, Any], mesh: LocalMesh) -> np.ndarray:
    """Return `LocalMesh.placed` of a checkpoint, zero where `resume` will refuse it (collective).

    header : of `open_checkpoint`.  Raises InputError when the file belongs to another mesh or is
    damaged.
    """
    assert mesh.placed is not None  # of every run that places something
    like = mesh.placed
    array = header["arrays"].get(PLACED)
    if array is None or (array.shape[1:], array.dtype) != (like.shape[1:], like.dtype):
        return like
    only = header | {"arrays": {PLACED: array}}
    return read_arrays(path, only, mesh)[PLACED]


def _require_forces(path, arrays, state):
    """Raise InputError where forces or flows are asked for that the run before did not keep."""
    if "solid.force" in state and "solid.force" not in arrays:
        text = "received a [[force]] or a [[surface]] that the run of the checkpoint had not"
        raise InputError(f"{path}: {text}, expected its own; leave it out, or start anew")


def _require_arrays(arrays, state):
    """Raise ValueError unless the arrays of a checkpoint are those of a state, name -> (n_owned,
    ...), but for its rows.

    arrays : name -> `Dataset`.  What not every state has, as the points of tangents, has the shape
    of the field in its name.
    """
    missing = [name for name in state if name not in arrays]
    if missing:
        raise ValueError(f"its array {missing[0]} is missing")
    for name, array in arrays.items():
        like = state.get(name)
        if like is None and (known := LIKE.search(name)):
            like = state["fluid.p" if known[1] == "p" else "solid.u"]
        if like is not None and (array.shape[1:], array.dtype) != (like.shape[1:], like.dtype):
            received, expected = (
                f"rows of shape {x.shape[1:]} of {x.dtype}" for x in (array, like)
            )
            raise ValueError(f"its array {name} has {received}, expected {expected}")


def _load(path, header, arrays, scene, loop, coupling, energy, measures):
    if header["time"] > scene.time.end:
        received = f"the checkpoint is at t = {header['time']:g} s"
        raise InputError(
            f"{path}: {received}, expected at most time.end = {scene.time.end:g} s; raise time.end"
        )
    loop.clock.load(header["clock"])
    loop.iterations.extend(header["iterations"])
    if loop.auto:
        loop.auto.resume(header["coupling"])
        measures.remodel(loop.auto.scene)
    schemes, rates = loop.clock.next_schemes(loop.model)
    coupling.load_state(arrays, header["coupling"], schemes, rates)
    energy.load(header["energy"])
    measures.load(header["measures"], header["time"])
    if "datum.u" in arrays:
        measures.datum = coupling.solid.mesh.halo.extend(arrays["datum.u"])
    if loop.control and header["step_control"]:
        loop.control.load(arrays, header["step_control"])


def _require_same_scene(path, header, scene, text):
    """Raise InputError where the scene of a checkpoint is another one, ValueError where it is
    none.
    """
    contents = header.get("tables")  # None in one of an earlier version
    before = comparable(_scene_of(header), contents)
    now = comparable(parse_toml(text), contents if contents is None else table_contents(scene))
    stage = header.get("stage", 0)
    fixed = _fixed(now, before, stage)
    for section, old in _fixed(before, now, stage).items():
        new = fixed[section]
        if old != new:
            key, received, expected = _difference(section, new, old)
            if key.endswith(".table") and contents is not None:
                text = (
                    "the table has other numbers than when the checkpoint was written; restart with"
                    " the same table"
                )
            else:
                both = (
                    f"the checkpoint was written with {shown(expected)}, the scene has"
                    f" {shown(received)}"
                )
                text = f"{both}; restart with the same value"
            raise InputError(f"{path} [{key}]: {text}")


def _scene_of(header):
    try:
        return parse_toml(header["scene"])
    except (ValueError, RecursionError) as failure:
        raise ValueError(f"its entry scene is no TOML: {failure}") from failure


def _fixed(scene, other, stage):
    """Return the tables of a scene (as TOML) that another one must have too, and of its stages up
    to the one of a number.
    """
    fixed: dict = {section: scene.get(section) for section in FIXED}
    past = scene.get("stage", [])[:stage]
    keys = (*FIXED, "tie", "inactive", "active", "gradual", "reset_displacement")
    changes = [[entry.get(key, ()) for key in CHANGES] for entry in scene.get("stage", [])]
    fixed["stage.active"] = absent_at_start(changes)
    fixed["stage"] = [{key: entry.get(key) for key in keys} for entry in past]
    if past:
        fixed["time"] = {"end": scene["time"]["end"]}
    for entry, over in zip(fixed["stage"], past[:-1], strict=False):  # without the present one
        entry["time"] = {"end": over["time"].get("end")}
    if past and past[-1].get("gradual"):  # its end is in the force that fades
        fixed["stage"][-1]["time"] = {"end": past[-1]["time"].get("end")}
    fixed["initial"] = {"stress": scene.get("initial", {}).get("stress")}  # acts at all times
    if "reference" in scene and "reference" in other:
        fixed["reference"] = {key: scene["reference"].get(key) for key in COMPARED}
    return fixed


def _difference(key, new, old):
    """Return the dotted key, new and old value of the first difference."""
    if isinstance(new, dict) and isinstance(old, dict):
        name = next(k for k in [*old, *new] if old.get(k) != new.get(k))
        return _difference(f"{key}.{name}", new.get(name), old.get(name))
    if isinstance(new, list) and isinstance(old, list) and len(new) == len(old):
        i = next(i for i, (a, b) in enumerate(zip(new, old, strict=True)) if a != b)
        return _difference(f"{key}.{i}", new[i], old[i])
    return key, new, old
