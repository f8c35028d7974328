"""The figures of a run, made from its result directory alone."""

from collections.abc import Callable, Iterable, KeysView, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from .field_plots import deformation_scale, displacement, draw_field
from .files import parse_toml, publish, temporary_name
from .history import NAME as HISTORY
from .history import read_history
from .history_plots import draw_histories, draw_paths, kind_of
from .lines import draw_line, file_of, read_line
from .profiles import NAME as PROFILES
from .profiles import draw_profiles, read_profiles
from .snapshots import Snapshot, has_mesh, read_snapshots
from .surface import read_regions, read_surface

STYLE = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "lines.linewidth": 1.2,
    "axes.grid": False,
    "axes.formatter.limits": (-3, 5),
    "axes.formatter.use_mathtext": True,
    "mathtext.fontset": "stix",
    "font.family": ["DejaVu Sans"],
}
DPI = 200
PANELS_WITHOUT_TIMES = 4


def make_figures(directory: Path) -> list[Path]:
    """Draw the figures of a run into its directory; return the paths written.

    They are pressure.png, velocity.png, displacement.png, histories.png, paths.png, reference.png
    and line_<name>.png; those without data (no fields or no history written, no path, no reference
    or no line asked for, no free fluid) are left out.  On the calling rank only. Raises InputError
    when the directory is not a result directory.
    """
    directory = Path(directory)
    scene = _scene(directory)
    return _field_figures(directory, scene, scene.get("figures", {})) + make_curves(directory)


def make_curves(directory: Path) -> list[Path]:
    """Draw the figures of `make_figures` that need no fields, which are as large as the mesh."""
    directory = Path(directory)
    scene = _scene(directory)
    curves = _history_figures(directory, scene) + _line_figures(directory, scene)
    return curves + _reference_figure(directory)


def _scene(directory):
    scene = directory / "scene.toml"
    if not scene.is_file():
        raise InputError(
            f"{directory}: no scene.toml there, expected the result directory of a run; give the"
            " DIR of porofsi run"
        )
    try:
        return parse_toml(scene.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as failure:
        text = f"damaged, expected the scene in TOML that porofsi run wrote ({failure})"
        raise InputError(
            f"{scene}: {text}; write it again with porofsi run … --restart"
        ) from failure


def _field_figures(directory, scene, settings):
    snapshots = choose_snapshots(read_snapshots(directory), settings.get("times", []))
    if not snapshots or not has_mesh(directory):
        return []
    media = media_of(scene, read_regions(directory))
    cut = settings.get("cut")
    written = []
    for picture in PICTURES:
        shown = [region for region, medium in media.items() if medium in picture.media]
        if shown and all(picture.field in s.shapes for s in snapshots):
            surface = read_surface(directory, cut, shown)
            rest = media.keys() - set(shown) if picture.with_solid else None
            backdrop = read_surface(directory, cut, rest) if rest else None
            magnification = settings.get("deformation_scale") or deformation_scale(
                snapshots, surface
            )
            values = [picture.values(s, surface) for s in snapshots]
            path = directory / f"{picture.name}.png"
            label = (picture.text(media), picture.unit)
            written.append(
                save_figure(
                    path, draw_field, snapshots, values, surface, label, magnification, backdrop
                )
            )
    return written


def media_of(scene: dict[str, Any], regions: Sequence[str]) -> dict[str, str]:
    """Return region -> "porous", "fluid" or "solid" by the materials of a scene (dict of its
    TOML).
    """
    found = dict.fromkeys(regions, "porous")
    for material in scene.get("material", []):
        medium = (
            "porous"
            if material.get("solid") and material.get("fluid")
            else "fluid"
            if material.get("fluid")
            else "solid"
        )
        named = material["region"]
        found |= {
            region: medium for region in regions if region in named or named in ("all", ["all"])
        }
    return found


def _pressure(snapshot, surface):
    return snapshot.read("pressure")


def _speed(snapshot, surface):
    return np.linalg.norm(snapshot.read("fluid velocity"), axis=1)


def _magnitude(snapshot, surface):
    return np.linalg.norm(displacement(snapshot, surface), axis=1)


@dataclass(frozen=True)
class Picture:
    """A field drawn where the media have it.

    values : (snapshot, surface) -> (N,) in SI; words : label by medium; with_solid : what is left
    of the mesh is drawn in grey
    """

    name: str
    field: str
    values: Callable
    unit: str
    words: dict
    with_solid: bool

    @property
    def media(self) -> KeysView[str]:
        """Return the media it is drawn in."""
        return self.words.keys()

    def text(self, media: dict[str, str]) -> str:
        """Return the label: that of the first of its media that the mesh has."""
        return next(text for medium, text in self.words.items() if medium in media.values())


PICTURES = (
    Picture(
        "pressure",
        "pressure",
        _pressure,
        "Pa",
        {"fluid": "pressure", "porous": "pore pressure"},
        True,
    ),
    Picture("velocity", "fluid velocity", _speed, "m/s", {"fluid": "speed of the fluid"}, True),
    Picture(
        "displacement",
        "displacement",
        _magnitude,
        "m",
        dict.fromkeys(("porous", "solid"), "displacement magnitude"),
        False,
    ),
)


def choose_snapshots(snapshots: Sequence[Snapshot], times: Sequence[float]) -> list[Snapshot]:
    """Return the snapshots nearest to the times [s], each once; without times up to four evenly
    spaced ones.
    """
    if not snapshots:
        return []
    chosen: Iterable[float]
    if len(times) == 0:
        skip = max(len(snapshots) - PANELS_WITHOUT_TIMES, 0) / PANELS_WITHOUT_TIMES
        chosen = np.linspace(
            skip, len(snapshots) - 1, min(len(snapshots), PANELS_WITHOUT_TIMES)
        ).round()
    else:
        chosen = [int(np.abs([s.time - t for s in snapshots]).argmin()) for t in times]
    return [snapshots[i] for i in sorted({int(i) for i in chosen})]


def _history_figures(directory, scene):
    if not (directory / HISTORY).is_file():
        return []
    history = read_history(directory / HISTORY)
    if len(history["t"]) < 2:
        return []
    path = directory / "histories.png"
    written = [save_figure(path, draw_histories, history, _is_plane(scene.get("mesh", {})))]
    settings = scene.get("figures", {})
    probes = [
        name
        for name in settings.get("paths", [])
        if f"{name}.u_x" in history and f"{name}.u_y" in history
    ]
    if probes:
        written.append(save_figure(directory / "paths.png", draw_paths, history, probes))
    return written


def _line_figures(directory, scene):
    written = []
    for entry in scene.get("line", []):
        path = directory / file_of(entry["name"])
        line = read_line(path) if path.is_file() else {"t": ()}
        if len(line["t"]) and any(kind_of(name)[0] for name in entry["quantities"]):
            written.append(save_figure(path.with_suffix(".png"), draw_line, line))
    return written


def _is_plane(mesh):
    """Return whether a [mesh] is one of plane strain, not of a body in space."""
    in_plane = mesh.get("kind") == "rectangle" or mesh.get("dim") == 2
    return in_plane and not mesh.get("axisymmetric", False)


def _reference_figure(directory):
    if not (directory / PROFILES).is_file():
        return []
    return [
        save_figure(directory / "reference.png", draw_profiles, read_profiles(directory / PROFILES))
    ]


def save_figure(path: Path, draw: Callable, *arguments: Any) -> Path:
    """Draw into a figure of its own, without pyplot, and write it atomically; return its path."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure, *arguments)
        figure.savefig(temporary_name(path), dpi=DPI, format="png")
    publish(path)
    return path
