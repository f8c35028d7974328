"""The figures of a run, made from its result directory alone."""

from pathlib import Path

import numpy as np

from ..errors import InputError
from .field_plots import deformation_scale, displacement, draw_field
from .fields import FOLDER, read_snapshots
from .files import parse_toml, publish, temporary_name
from .hdf5 import read_slab
from .history import NAME as HISTORY
from .history import read_history
from .history_plots import draw_histories, draw_paths
from .profiles import NAME as PROFILES
from .profiles import draw_profiles, read_profiles
from .surface import read_surface

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
    "axes.formatter.limits": (-4, 5),
    "axes.formatter.use_mathtext": True,
    "mathtext.fontset": "stix",
    "font.family": ["DejaVu Sans"],
}
DPI = 200
PANELS_WITHOUT_TIMES = 4


def make_figures(directory):
    """Draw the figures of a run into its directory; return the paths written.

    They are pressure.png, displacement.png, histories.png, paths.png and reference.png; those without data (no fields or no
    history written, no path or no reference asked for) are left out.  On the calling rank only.
    Raises InputError when the directory is not a result directory.
    """
    directory = Path(directory)
    settings = _settings(directory)
    return _field_figures(directory, settings) + _history_figures(directory, settings) + _reference_figure(directory)


def _settings(directory):
    scene = directory / "scene.toml"
    if not scene.is_file():
        raise InputError(f"{directory}: no scene.toml there, expected the result directory of a run; give the DIR of porofsi run")
    return parse_toml(scene.read_text(encoding="utf-8")).get("figures", {})


def _field_figures(directory, settings):
    snapshots = choose_snapshots(read_snapshots(directory), settings.get("times", []))
    if not snapshots or not (directory / FOLDER / "mesh.h5").is_file():
        return []
    surface = read_surface(directory, settings.get("cut"))
    magnification = settings.get("deformation_scale") or deformation_scale(snapshots, surface)
    written = []
    for name, (values_of, label) in FIELDS.items():
        if all(name in s.shapes for s in snapshots):
            values = [values_of(s, surface) for s in snapshots]
            path = directory / f"{name}.png"
            written.append(save_figure(path, draw_field, snapshots, values, surface, label, magnification))
    return written


def _pressure(snapshot, surface):
    return read_slab(snapshot.path, "pressure")


def _magnitude(snapshot, surface):
    return np.linalg.norm(displacement(snapshot, surface), axis=1)


FIELDS = {
    "pressure": (_pressure, ("pore pressure", "Pa")),
    "displacement": (_magnitude, ("displacement magnitude", "m")),
}


def choose_snapshots(snapshots, times):
    """Return the snapshots nearest to the times [s], each once; without times up to four evenly spaced ones."""
    if not snapshots:
        return []
    if len(times) == 0:
        skip = max(len(snapshots) - PANELS_WITHOUT_TIMES, 0) / PANELS_WITHOUT_TIMES
        chosen = np.linspace(skip, len(snapshots) - 1, min(len(snapshots), PANELS_WITHOUT_TIMES)).round()
    else:
        chosen = [np.abs([s.time - t for s in snapshots]).argmin() for t in times]
    return [snapshots[i] for i in sorted({int(i) for i in chosen})]


def _history_figures(directory, settings):
    if not (directory / HISTORY).is_file():
        return []
    history = read_history(directory / HISTORY)
    if len(history["t"]) < 2:
        return []
    written = [save_figure(directory / "histories.png", draw_histories, history)]
    probes = [name for name in settings.get("paths", []) if f"{name}.u_x" in history and f"{name}.u_y" in history]
    if probes:
        written.append(save_figure(directory / "paths.png", draw_paths, history, probes))
    return written


def _reference_figure(directory):
    if not (directory / PROFILES).is_file():
        return []
    return [save_figure(directory / "reference.png", draw_profiles, read_profiles(directory / PROFILES))]


def save_figure(path, draw, *arguments):
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
