"""What `porofsi info` says about a file or a result directory."""

import json
import os
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ..errors import InputError
from ..mesh.read import read_mesh
from . import checkpoint, history, summary
from .files import parse_toml
from .snapshots import fields_file, read_snapshots

SHORT_SUMMARY = (
    "scene",
    "title",
    "version",
    "exit_code",
    "ranks",
    "elements",
    "nodes",
    "steps",
    "time_end",
    "wall_time.total",
    "coupling_iterations.mean",
    "coupling_iterations.max",
    "energy.balance_error_relative",
    "peak_memory_bytes.sum",
)


def describe(path: str | os.PathLike[str]) -> str:
    """Return a short text about a checkpoint, a summary.json, a history.csv, a mesh file or a
    result directory.

    Raises InputError when there is no such file or it is none of these.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(
            f"{path}: no such file; give a checkpoint, a summary.json, a mesh file or a result"
            " directory"
        )
    if path.is_dir():
        return _describe_directory(path)
    if path.suffix == ".json":
        return _describe_summary(path)
    if path.suffix == ".csv":
        return _describe_history(path)
    if path.suffix == ".h5":
        return _describe_checkpoint(path)
    return _describe_mesh(path)


def _table(title, rows):
    width = max(len(name) for name, _ in rows)
    return "\n".join([str(title), *(f"  {name:<{width}}  {value}" for name, value in rows)])


def _describe_checkpoint(path):
    header = checkpoint.open_checkpoint(path, MPI.COMM_SELF)
    rows = [
        ("step", header.get("step")),
        ("time", f"{header.get('time')} s"),
        ("scene", _title(header.get("scene"))),
    ]
    rows += [
        ("checksum", "right" if header["sealed"] else "none, an earlier version wrote the file")
    ]
    rows += [
        (key.replace("_", " "), header[key])
        for key in ("ranks", "nodes", "mesh_hash", "format_version")
    ]
    rows += [
        (f"array {name}", " x ".join(map(str, array.shape)))
        for name, array in header["arrays"].items()
    ]
    return _table(f"checkpoint {path}", rows)


def _title(scene):
    try:
        return parse_toml(scene).get("title", "without title") if scene else "not stated"
    except (TypeError, ValueError, RecursionError):
        return "not readable"


def _describe_summary(path):
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        rows = [(key, _value(content, key)) for key in SHORT_SUMMARY]
    except (ValueError, KeyError, TypeError) as failure:
        raise InputError(
            f"{path}: not a summary.json written by porofsi; give the one in a result directory"
        ) from failure
    rows += [(f"expect {r['quantity']}", _verdict(r)) for r in content["expectations"]]
    return _table(f"summary {path}", rows)


def _value(content, key):
    for part in key.split("."):
        content = content[part]
    unit = summary.SUMMARY_KEYS[key].partition("[")[2].partition("]")[0].split(",")[0]
    number = f"{content:.6g}" if isinstance(content, float) else str(content)
    return f"{number} {unit}" if unit in ("s", "bytes") else number


def _verdict(record):
    if record["passed"] is None:
        return f"skipped: {record['reason']}"
    verdict = "passed" if record["passed"] else "FAILED"
    return (
        f"{verdict}: {record['value']:.6g}, expected {record['reference']:.6g}, error"
        f" {record['error']:.2g}"
    )


def _describe_history(path):
    columns = history.read_history(path)
    t = columns["t"]
    span = f"{t[0]:.6g} s to {t[-1]:.6g} s" if len(t) else "empty"
    return _table(
        f"history {path}", [("rows", len(t)), ("time", span), ("columns", ", ".join(columns))]
    )


def _describe_directory(path):
    parts = []
    for name, part in (
        (summary.NAME, _describe_summary),
        (history.NAME, _describe_history),
        (checkpoint.NAME, _describe_checkpoint),
    ):
        if (path / name).is_file():
            parts.append(part(path / name))
    snapshots = read_snapshots(path)
    if snapshots:
        span = f"{snapshots[0].time:.6g} s to {snapshots[-1].time:.6g} s"
        rows = [("times", f"{len(snapshots)}, {span}"), ("names", ", ".join(snapshots[-1].shapes))]
        parts.append(_table(f"fields {fields_file(path)}", rows))
    if not parts:
        raise InputError(
            f"{path}: holds no results of porofsi; give the DIR of porofsi run, or a file"
        )
    return "\n".join(parts)


def _describe_mesh(path):
    mesh = _read_mesh_of_any_dimension(path)
    rows = [
        ("dimension", mesh.dim),
        ("cells", f"{len(mesh.cells)} {mesh.element.name}"),
        ("nodes", len(mesh.points)),
        (
            "box",
            " x ".join(
                f"[{a:g}, {b:g}]"
                for a, b in zip(mesh.points.min(0), mesh.points.max(0), strict=True)
            )
            + " m",
        ),
        ("hash", mesh.hash),
    ]
    counts = np.bincount(mesh.cell_region, minlength=len(mesh.regions))
    rows += [
        (f"region {name}", f"{count} cells")
        for name, count in zip(mesh.regions, counts, strict=True)
    ]
    rows += [(f"tag {tag}", f"{len(facets)} facets") for tag, facets in mesh.facets.items()]
    rows += [("note", note) for note in mesh.notes]
    return _table(f"mesh {path}", rows)


def _read_mesh_of_any_dimension(path):
    try:
        return read_mesh(path, 2)
    except InputError as plane:
        try:
            return read_mesh(path, 3)
        except InputError as solid:
            if str(plane) == str(solid):
                raise
            raise InputError(f"read as a 2-D mesh: {plane}; read as a 3-D mesh: {solid}") from solid
