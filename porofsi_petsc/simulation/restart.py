"""Continue from a checkpoint, on any number of ranks; what may have changed in the scene and what not."""

from ..config import completed
from ..errors import InputError
from ..output.checkpoint import read_checkpoint
from ..output.files import parse_toml

# Sections that decide the state itself; time, output, solver and coupling settings may change.
FIXED = ("model", "material", "boundary", "body_force", "stabilization")
COMPARED = ("solution", "load", "length", "frequency", "surface")  # of [reference]: errors before and after belong together


def resume(path, mesh, scene, text, loop, coupling, energy, measures):
    """Load every part of a run from a checkpoint; text is the present scene as TOML (collective).

    Raises InputError when the file is no checkpoint, belongs to another mesh or scene, or lies beyond the end time.
    """
    header, arrays = read_checkpoint(path, mesh)
    try:
        _load(path, header, arrays, scene, text, loop, coupling, energy, measures)
    except (KeyError, TypeError) as missing:
        raise InputError(f"{path}: damaged, its entry {missing} is missing or unreadable; use an earlier checkpoint") from missing


def _load(path, header, arrays, scene, text, loop, coupling, energy, measures):
    _require_same_scene(path, completed(parse_toml(header["scene"])), parse_toml(text))
    if header["time"] >= scene.time.end:
        received = f"the checkpoint is at t = {header['time']:g} s"
        raise InputError(f"{path}: {received}, expected less than time.end = {scene.time.end:g} s; raise time.end")
    loop.clock.load(header["clock"])
    loop.iterations.extend(header["iterations"])
    if loop.auto:
        loop.auto.resume(header["coupling"])
        measures.remodel(loop.auto.scene)
    schemes, rates = loop.clock.next_schemes(loop.model)
    coupling.load_state(arrays, header["coupling"], schemes, rates)
    energy.load(header["energy"])
    measures.load(header["measures"], header["time"])
    if loop.control and header["step_control"]:
        loop.control.load(arrays, header["step_control"])


def _require_same_scene(path, before, now):
    fixed = _fixed(now, before)
    for section, old in _fixed(before, now).items():
        new = fixed[section]
        if old != new:
            key, received, expected = _difference(section, new, old)
            text = f"the checkpoint was written with {expected!r}, the scene has {received!r}; restart with the same value"
            raise InputError(f"{path} [{key}]: {text}")


def _fixed(scene, other):
    """Return the tables of a scene (as TOML) that another one must have too."""
    fixed = {section: scene.get(section) for section in FIXED}
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
