"""What may be prescribed together for the pore fluid on a surface of a porous medium.

Through a surface the volume balance knows either a pressure or a seepage flux, which is zero where none is given: v_f·n = v_s·n.
A normal velocity of the fluid beside a pressure, or another one than that of the wall, contradicts it.
"""

import collections

import numpy as np

from ..errors import InputError
from ..fem.boundary import facet_normals
from .conditions import components, sample_times

SAME = 1e-3  # of the largest velocity: below errors of discretization, above the digits of numbers that were written by hand


def require_one_drainage(scene, mesh):
    """Raise InputError where a normal velocity has a pressure beside it, or no flux and is not the wall's (collective)."""
    where, tags = scene.source_path or "scene", collections.defaultdict(dict)
    for i, boundary in enumerate(scene.boundary):
        for tag in boundary.on:
            tags[tag] |= {(name, c): (i, e) for name in ("velocity", "displacement") for c, e in _vector(boundary, name)}
            tags[tag] |= {name: i for name in ("pressure", "flux") if getattr(boundary, name) is not None}
    for tag, given in sorted(tags.items()):
        velocity = {key[1]: entry for key, entry in given.items() if key[0] == "velocity"}
        if not velocity or not holds_normal(mesh, tag, sorted(velocity)):
            continue
        place = f"{where} [boundary.{velocity[min(velocity)][0]}.velocity]: tag '{tag}'"
        if "pressure" in given:
            first = f"boundary.{given['pressure']}.pressure"
            text = f"has {first}, which lets the fluid flow as it will, beside the normal velocity; remove one of the two"
            raise InputError(f"{place} {text}")
        if "flux" not in given:
            _require_wall(scene, mesh, tag, given, velocity, place)


def holds_normal(mesh, tag, held):
    """Return whether the prescribed components hold more than half of the mean squared normal (collective)."""
    facets = mesh.facets[tag]
    normal2 = (facet_normals(mesh, facets.nodes[facets.owned]) ** 2).sum(axis=0)
    normal2 = mesh.comm.allreduce(normal2)
    return normal2[held].sum() > 0.5 * normal2.sum()


def _vector(boundary, name):
    return components(getattr(boundary, name)).items()


def _require_wall(scene, mesh, tag, given, velocity, place):
    """Raise InputError where the normal velocity is not that of the wall, at rest where its displacement is free (collective)."""
    facets = mesh.facets[tag]
    nodes = facets.nodes[facets.owned]
    normal, X = facet_normals(mesh, nodes), mesh.X[nodes].mean(axis=1)
    moves = {c: given["displacement", c][1] for c in velocity if ("displacement", c) in given}
    rest = components(scene.initial.displacement)  # what is given there does not jump
    for start, end in _spans(scene.time):
        flow, largest = np.zeros(len(X)), 0.0
        for c, (_, expression) in velocity.items():
            relative = expression(end, X)
            largest = max(largest, np.abs(relative).max(initial=0.0))
            if c in moves:
                before = moves[c](start, X) if start or c in rest else 0.0
                rate = (moves[c](end, X) - before) / (end - start)
                relative, largest = relative - rate, max(largest, np.abs(rate).max(initial=0.0))
            flow += relative * normal[:, c]
        here, scale = np.abs(flow).max(initial=0.0), max(mesh.comm.allgather(float(largest)))
        flow = max(mesh.comm.allgather(float(here)))
        if flow > SAME * scale:
            received = f"received a velocity of {flow:g} m/s through the wall at t = {end:g} s"
            advice = "expected that of the wall, v_f·n = v_s·n; prescribe `flux` = n_f (v_f - v_s)·n instead, or no velocity"
            raise InputError(f"{place}: {received}, {advice}")


def _spans(section):
    """Return pairs of times [s]: the first step, which a sudden displacement is part of, and short ones over the run."""
    tiny = 1e-6 * section.step
    return [(0.0, section.step), *((t, t + tiny) for t in sample_times(section)[1:])]
