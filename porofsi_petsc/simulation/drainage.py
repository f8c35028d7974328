"""What may be prescribed together for the pore fluid on a surface of a porous medium.

Through a surface the volume balance knows either a pressure or a seepage flux, which is zero where
none is given: v_f·n = v_s·n. A normal velocity of the fluid beside a pressure, or another one than
that of the wall, contradicts it.
"""

import collections
from collections.abc import Collection
from typing import Any

import numpy as np

from ..config import Scene
from ..errors import InputError
from ..fem.boundary import facet_normals
from ..fem.distribute import LocalMesh
from .conditions import at_once, components, just_after, rate_after, sample_times

# Of the largest velocity in the run: below errors of discretization, above the digits of numbers
# that were written by hand.
SAME = 1e-3


def require_one_drainage(scene: Scene, mesh: LocalMesh) -> None:
    """Raise InputError where a normal velocity has a pressure beside it, or no flux and is not the
    wall's (collective).
    """
    where = scene.source_path or "scene"
    tags: dict[str, dict[Any, Any]] = collections.defaultdict(dict)
    for i, boundary in enumerate(scene.boundary):
        for tag in boundary.on:
            tags[tag] |= {
                (name, c): (i, e)
                for name in ("velocity", "displacement")
                for c, e in _vector(boundary, name)
            }
            tags[tag] |= {
                name: i for name in {"pressure", "seepage", "flux"} & set(boundary.given())
            }
    for tag, given in sorted(tags.items()):
        velocity = {key[1]: entry for key, entry in given.items() if key[0] == "velocity"}
        if not velocity or not holds_normal(mesh, tag, sorted(velocity)):
            continue
        place = f"{where} [boundary.{velocity[min(velocity)][0]}.velocity]: tag '{tag}'"
        drained = [name for name in ("pressure", "seepage") if name in given]
        if drained:
            first = f"boundary.{given[drained[0]]}.{drained[0]}"
            text = (
                f"has {first}, which lets the fluid flow as it will, beside the normal velocity;"
                " remove one of the two"
            )
            raise InputError(f"{place} {text}")
        if "flux" not in given:
            _require_wall(scene, mesh, tag, given, velocity, place)


def holds_normal(mesh: LocalMesh, tag: str, held: Collection[int]) -> bool:
    """Return whether the prescribed components hold more than half of the mean squared normal
    (collective).
    """
    facets = mesh.facets[tag]
    normal2 = (facet_normals(mesh, facets.nodes[facets.owned]) ** 2).sum(axis=0)
    normal2 = mesh.comm.allreduce(normal2)
    return normal2[held].sum() > 0.5 * normal2.sum()


def _vector(boundary, name):
    return components(getattr(boundary, name)).items()


def _require_wall(scene, mesh, tag, given, velocity, place):
    """Raise InputError where the normal velocity is not that of the wall, at rest where its
    displacement is free (collective).
    """
    facets = mesh.facets[tag]
    nodes = facets.nodes[facets.owned]
    normal = facet_normals(mesh, nodes)
    X = mesh.X[nodes].mean(axis=1)
    moves = {c: given["displacement", c][1] for c in velocity if ("displacement", c) in given}
    pairs = [(normal[:, c], expression, moves.get(c)) for c, (_, expression) in velocity.items()]
    jumps = [
        c not in components(scene.initial.displacement) for c in velocity
    ]  # what is given there does not jump
    times = sample_times(scene.time)[1:]
    found = [
        *([] if scene.time.begins else [_first_step(pairs, jumps, X, scene.time)]),
        *(_instant(pairs, X, t, scene.time) for t in times),
    ]
    flows = np.max(mesh.comm.allgather([flow for flow, _ in found]), axis=0)
    scale = max(mesh.comm.allgather(max(largest for _, largest in found)))
    first = [] if scene.time.begins else [scene.time.step]
    for t, flow in zip([*first, *times], flows, strict=True):
        if flow > SAME * scale:
            received = f"received a velocity of {flow:g} m/s through the wall at t = {t:g} s"
            advice = (
                "expected that of the wall, v_f·n = v_s·n; prescribe `flux` = n_f (v_f - v_s)·n"
                " instead, or no velocity"
            )
            raise InputError(f"{place}: {received}, {advice}")


def _first_step(pairs, jumps, X, section):
    """Return the largest mean flow of this rank through the wall in the first step, a sudden
    displacement is part of which.

    The integral of v_f is that of Simpson's rule; what differs from the trapezoidal rule is
    uncertain.
    """
    compared = []
    step = section.step
    for (normal, expression, moves), jump in zip(pairs, jumps, strict=True):
        first, middle, last = (expression(t, X) for t in (at_once(section), step / 2, step))
        wall = np.zeros(len(X))
        if moves is not None:
            wall = (moves(step, X) - (0.0 if jump else moves(0.0, X))) / step
        mean = (first + 4 * middle + last) / 6
        compared.append((normal, mean, wall, np.abs(mean - (first + last) / 2)))
    return _through(compared)


def _instant(pairs, X, t, section):
    """Return the largest flow of this rank through the wall at a time."""
    compared = []
    for normal, expression, moves in pairs:
        wall = np.zeros(len(X))
        uncertain = 0.0
        if moves is not None:
            wall, uncertain = rate_after(lambda s, moves=moves: moves(s, X), t, section)
        compared.append((normal, expression(just_after(t, section), X), wall, uncertain))
    return _through(compared)


def _through(compared):
    """Return the largest certain flow |(v_f - v_s)·n| and velocity of (n, v_f, v_s, error of v_s)
    per component, (F,) each.
    """
    flow = sum((v_f - v_s) * normal for normal, v_f, v_s, _ in compared)
    error = sum(uncertain * np.abs(normal) for normal, *_, uncertain in compared)
    largest = max(
        float(np.abs(v).max(initial=0.0)) for _, v_f, v_s, _ in compared for v in (v_f, v_s)
    )
    return float((np.abs(flow) - error).max(initial=0.0)), largest
