"""A porous plug at the end of a channel, through which a free fluid flows: scene and state of a
column.
"""

import numpy as np
from scipy.integrate import cumulative_simpson, solve_ivp

U = 0.3  # velocity of the inflow [m/s]
MU = 2.0  # viscosity [Pa s]
K = 1e-6  # permeability at rest [m²]
MODULUS = 2e6  # λ + 2μ of the plug [Pa]
LENGTH = 1.0  # of the plug [m]


def plug(cells=4, order=2, law="xie_leo", permeability=None, speed=U, **changes):
    """Return a scene: fluid from x = 0 to 1 m, the plug from 1 m to 2 m, held at its end; changes
    are sections of the scene, those of dicts in parts.
    """
    porous = {
        "region": "plug",
        "porosity": 0.4,
        "solid": {"law": law, "lambda": 1e6, "mu": 0.5e6, "density": 2000.0},
        "fluid": {"density": 1000.0, "viscosity": MU},
        "permeability": permeability or {"law": "constant", "intrinsic": K},
    }
    porous |= changes.pop("porous", {})
    scene = {
        "title": "A plug at the end of a channel",
        "mesh": {
            "kind": "rectangle",
            "order": order,
            "x": {"points": [0.0, 1.0, 2.0], "cells": [2, cells]},
            "y": {"points": [0.0, 0.5], "cells": [1]},
            "regions": [{"name": "plug", "x": [1.0, 2.0]}],
        },
        "model": {
            "solid_inertia": False,
            "fluid_inertia": False,
            "viscosity": True,
            "convection": False,
            "moving_mesh": True,
            "porosity": "variable",
        },
        "time": {"scheme": "steady", "end": 1.0, "step": 1.0},
        "material": [{"region": "body", "fluid": {"density": 1000.0, "viscosity": MU}}, porous],
        "boundary": [
            {"on": "left", "velocity": {"x": speed, "y": 0.0}},
            {"on": ["bottom", "top"], "velocity": {"y": 0.0}, "displacement": {"y": 0.0}},
            {"on": "right", "displacement": {"x": 0.0}},
        ],
        "probe": [
            {"name": "inlet", "at": [0.0, 0.25], "quantities": ["p"]},
            {"name": "face", "at": [1.0, 0.25], "quantities": ["u_x", "vf_x", "n_f"]},
            {"name": "middle", "at": [1.5, 0.25], "quantities": ["u_x", "p"]},
        ],
        "coupling": {"scheme": "direct", "tolerance": 1e-9},
        "limits": {key: "report" for key in ("reynolds", "strain", "mesh_displacement")},
    }
    for key, value in changes.items():
        scene[key] = scene.get(key, {}) | value if isinstance(value, dict) else value
    return scene


def compressed(stress, factor, points=4001):
    """Return the state of the plug in a steady flow: X (n,) [m] from its face, J (n,), u (n,) and
    the pressure p (n,).

    stress : P(J) [Pa] in confined compression; factor : k/k0 of J.  dP/dX = -μ U J/(K k/k0), P(0)
    = 0, and p falls by the drag: P - p is constant, p = 0 at the end.
    """
    X = np.linspace(0.0, LENGTH, points)

    def slope(_, J):
        modulus = (stress(J + 1e-6) - stress(J - 1e-6)) / 2e-6
        return -MU * U * J / (K * factor(J)) / modulus

    J = solve_ivp(slope, (0.0, LENGTH), [1.0], t_eval=X, rtol=1e-11, atol=1e-12).y[0]
    moved = cumulative_simpson(J - 1, x=X, initial=0.0)
    return X, J, moved - moved[-1], stress(J) - stress(J[-1])


def moved_in_time(X, t, diffusivity, growth):
    """Return u(X, t) [m] of a plug of the laws of Xie & Leo, P = E_c ln J and k/k0 = J², from rest
    in a flow U = growth t, growth in [m/s²].

    Its balance P' = -μ J (U - ∂u/∂t)/K is ∂u/∂t = U + c ∂²u/∂X² at any strain, c = K0 E_c/μ; ∂u/∂X
    = 0 at X = 0 and u = 0 at X = L.
    """
    n = np.arange(200)
    k = (2 * n + 1) * np.pi / (2 * LENGTH)
    rate = diffusivity * k**2
    answers = growth * (t / rate - (1 - np.exp(-rate * t)) / rate**2)
    return (2 * (-1.0) ** n / (LENGTH * k) * np.cos(k * X) * answers).sum()
