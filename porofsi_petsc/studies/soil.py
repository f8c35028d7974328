"""Scenes of the studies as dictionaries: one soil, and a block of it that is loaded on half of its
drained top.
"""

from collections.abc import Sequence
from typing import Any

from ..config import Scene
from ..config.sections import Limits
from ..materials import ELASTIC

Tables = dict[str, Any]  # a section of a scene, or an entry of one
LAME = {"lambda": 8.375e6, "mu": 5.583e6}  # [Pa]
YOUNG = (
    LAME["mu"] * (3 * LAME["lambda"] + 2 * LAME["mu"]) / (LAME["lambda"] + LAME["mu"])
)  # [Pa], with ν = 0.3
POROSITY, SIZE = 0.33, 10.0  # [-], edge of the block [m]
SMALL_LOAD = 3e3  # [Pa], 0.015 % drained compression
COMPRESSION = 0.2  # drained, of the large-strain cases [-]
REPORT_ALL = {name: "report" for name in Limits.model_fields}


def confined_load(law: str, J: float, n_s0: float = 1 - POROSITY) -> float:
    """Return the pressure [Pa] under which the soil, laterally confined and drained, rests at the
    volume ratio J.
    """
    return -float(ELASTIC[law](LAME["lambda"], LAME["mu"], n_s0).confined(J))


def material(
    k: float | None,
    law: str = "linear_elastic",
    lame: dict[str, float] = LAME,
    porosity: float = POROSITY,
    grains: float = 2000.0,
    region: str = "body",
) -> Tables:
    """Return a [[material]] of permeability k [m/s], skeleton law and Lamé parameters [Pa], density
    of the grains [kg/m³].
    """
    return {
        "region": region,
        "porosity": porosity,
        "solid": {"law": law, "density": grains} | lame,
        "fluid": {"density": 1000.0, "specific_weight": 1e4},
        "permeability": {"law": "constant", "k": k},
    }


def lame(poisson: float, factor: float = 1.0) -> dict[str, float]:
    """Return the Lamé parameters of a soil of this Poisson's ratio, as many times as stiff as set A
    [Pa].
    """
    E = factor * YOUNG
    return {
        "lambda": E * poisson / ((1 + poisson) * (1 - 2 * poisson)),
        "mu": E / (2 * (1 + poisson)),
    }


def layers(number: int) -> list[Tables]:
    """Return the regions of a number of equal horizontal layers, from below: layer0, layer1, ..."""
    height = SIZE / number
    return [{"name": f"layer{i}", "y": [i * height, (i + 1) * height]} for i in range(number)]


def mesh(
    cells: int, order: int = 1, dim: int = 2, regions: Sequence[dict[str, Any]] = ()
) -> Tables:
    """Return a block of (even) cells in each direction, one half of its top the patch `load`."""
    half = {"points": [0.0, SIZE / 2, SIZE], "cells": [cells // 2, cells // 2]}
    height = {"points": [SIZE * i / max(len(regions), 1) for i in range(max(len(regions), 1) + 1)]}
    height["cells"] = [cells // (len(height["points"]) - 1)] * (len(height["points"]) - 1)
    patch = {"name": "load", "side": "top", "x": [0.0, SIZE / 2]}
    common = {"order": order, "patches": [patch], "regions": list(regions), "x": half}
    if dim == 2:
        return common | {"kind": "rectangle", "y": height, "diagonal": "alternating"}
    return common | {"kind": "box", "y": {"points": [0.0, SIZE], "cells": [cells]}, "z": height}


def column(cells: int, order: int = 1) -> Tables:
    """Return a column of one cell width, fine at its top."""
    height = {"points": [0.0, SIZE], "cells": [cells], "ratios": [0.2]}
    return {
        "kind": "rectangle",
        "order": order,
        "x": {"points": [0.0, 0.5], "cells": [1]},
        "y": height,
    }


def walls(dim: int = 2) -> list[Tables]:
    """Return impermeable rollers at the sides and the base."""
    sides = {
        "x": ["left", "right"],
        "y": ["front", "back"] if dim == 3 else ["bottom"],
        "z": ["bottom"],
    }
    return [
        {"on": sides[axis], "displacement": {axis: 0.0}, "velocity": {axis: 0.0}}
        for axis in "xyz"[:dim]
    ]


def boundary(load: str, dim: int = 2) -> list[Tables]:
    """Return `walls` and a drained top with a pressure `load` (formula, [Pa]) on the patch
    `load`.
    """
    traction = {"xyz"[dim - 1]: f"-({load})"}
    return [
        *walls(dim),
        {"on": ["top", "load"], "pressure": 0.0},
        {"on": "load", "traction": traction},
    ]


def covered(load: str) -> list[Tables]:
    """Return `walls` and a drained top with a pressure `load` (formula, [Pa]) on all of it."""
    return [*walls(), {"on": "top", "pressure": 0.0, "traction": {"y": f"-({load})"}}]


def model(dynamic: bool = True, finite: bool = False) -> Tables:
    """Return [model]: with or without inertia; at finite strain the mesh moves, convects and n_s =
    n_s0/J.
    """
    terms = {"solid_inertia": dynamic, "fluid_inertia": dynamic}
    return terms | (
        {"moving_mesh": True, "convection": dynamic, "porosity": "variable"} if finite else {}
    )


def scene(
    title: str,
    mesh: Tables,
    model: Tables,
    time: Tables,
    materials: list[Tables],
    boundary: list[Tables],
    **more: Any,
) -> Scene:
    """Return the validated scene of these sections; what a model leaves out is reported, not
    refused.
    """
    sections = {
        "title": title,
        "mesh": mesh,
        "model": model,
        "time": time,
        "material": materials,
        "boundary": boundary,
    }
    return Scene.model_validate(sections | {"limits": REPORT_ALL} | more)
