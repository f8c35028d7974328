"""Patch tests on distorted meshes of every element: what is linear is exact, and rigid motions are
free of stress (Irons & Razzaque 1972; Zienkiewicz & Taylor, vol. 1).
"""

from types import SimpleNamespace

import numpy as np
import pytest
from grids import cell_type, grid
from kernel_states import ON_ELEMENTS
from mixed import as_one, cut, unit_grid

from porofsi_petsc import Simulation
from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.fem.geometry import Rule, geometry
from porofsi_petsc.kernels import solid
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.mesh.topology import boundary_facets, cell_facets
from porofsi_petsc.registry import examples

ROUND_OFF = 1e-13  # of sums of a few hundred terms, over the largest of them
CASES = [(name, law) for name, law in ON_ELEMENTS if name in ELEMENTS]
CASES += [("mixed 2", "neo_hookean"), ("mixed 3", "neo_hookean")]
FINITE_STRAIN = [(name, law) for name, law in CASES if not ELASTIC[law].small_strain]


class Block:
    """A cube of 3 elements along an edge whose inner nodes are moved, curved elements of order 2
    included; "mixed 2", "mixed 3": one of linear cells of all shapes.
    """

    def __init__(self, name):
        points, self.cells, self.element = _mesh(name)
        element = self.element
        cell, local = boundary_facets(self.cells, element)
        self.inner = np.ones(len(points), dtype=bool)
        self.inner[cell_facets(self.cells, element)[cell, local]] = False
        random = np.random.default_rng(41).uniform(-1, 1, points.shape)
        self.X = points + 0.04 * self.inner[:, None] * random
        # the degree at which ∫ ∂N_a/∂x_i dV is exact on curved elements, d factors dx/dxi or dN/dxi
        self.geometry = geometry(
            Rule.of(element, element.dim * max(element.gradient_degree, 1) + element.order),
            self.X[self.cells],
        )
        assert self.geometry.dV.min() > 0

    def stress_residual(self, law, u):
        """Return the nodal forces, (N, d), and the sum of their parts' sizes."""
        parts = solid.stress_residual(self.geometry.G, self.geometry.dV, law, u[self.cells])
        total = np.zeros_like(self.X)
        np.add.at(total, self.cells, parts)
        return total, np.abs(parts).sum()


def _mesh(name):
    """Return points, cells and element."""
    shape, _, dim = name.partition(" ")
    if shape == "mixed":
        points, cells = cut(unit_grid(int(dim), 3))
        element = ELEMENTS[{"2": "Q4", "3": "H8"}[dim]]
        return points, as_one(cells, element), element
    axis = SimpleNamespace(points=[0.0, 1.0], cells=[3], ratios=None)
    mesh = grid(name, [axis] * ELEMENTS[name].dim)
    return mesh.points, mesh.cells, mesh.element


@pytest.fixture(scope="module")
def block(request):
    return Block(request.param)


@pytest.mark.parametrize("block, law", CASES, indirect=["block"], scope="module")
def test_a_linear_displacement_is_in_balance_at_inner_nodes(block, law):
    d = block.element.dim
    law = ELASTIC[law](lam=1.7, mu=0.8, n_s0=0.4, **examples(ELASTIC[law]))
    H = 0.1 * np.random.default_rng(42).standard_normal((d, d))
    force, size = block.stress_residual(law, block.X @ H.T + 0.3)
    assert np.abs(force[~block.inner]).max() > 1e-3
    assert np.abs(force[block.inner]).max() < ROUND_OFF * size


@pytest.mark.parametrize("block, law", FINITE_STRAIN, indirect=["block"], scope="module")
def test_a_rigid_motion_has_no_stress(block, law):
    d = block.element.dim
    law = ELASTIC[law](lam=1.7, mu=0.8, n_s0=0.4, **examples(ELASTIC[law]))
    Q = np.linalg.qr(np.random.default_rng(43).standard_normal((d, d)))[0]
    Q[:, 0] *= np.sign(np.linalg.det(Q))
    force, _ = block.stress_residual(law, block.X @ (Q - np.eye(d)).T + 0.3)
    assert np.abs(force).max() < ROUND_OFF


@pytest.mark.parametrize("pressure", ["3e4", "3e4*minimum(t, 1)"])
@pytest.mark.parametrize("name", ["T3", "Q9", "T4", "H20"])
@pytest.mark.usefixtures("petsc")
def test_a_held_body_takes_a_uniform_pressure(name, pressure):
    """Nothing flows and nothing else has a force: what is left is the round-off of the pressure."""
    element = ELEMENTS[name]
    axis = {"points": [0.0, 1.0], "cells": [2]}
    axes = "xyz"[: element.dim]
    sides = {"left", "right", "bottom"} | ({"front", "back"} if element.dim == 3 else set())
    held = {"displacement": dict.fromkeys(axes, 0.0)}
    scene = {
        "title": "uniform pressure",
        "mesh": {
            "kind": "rectangle" if element.dim == 2 else "box",
            "order": element.order,
            "cell_type": cell_type(name),
        }
        | {axis_name: axis for axis_name in axes},
        "model": {"solid_inertia": False, "fluid_inertia": False},
        "time": {"end": 1.0, "step": 0.5},
        "material": [
            {
                "region": "all",
                "porosity": 0.3,
                "solid": {"law": "linear_elastic", "mu": 5e6, "lambda": 6e6, "density": 2e3},
                "fluid": {"density": 1e3, "specific_weight": 1e4},
                "permeability": {"law": "constant", "k": 1e-5},
            }
        ],
        "boundary": [
            {"on": sorted(sides), **held},
            {"on": "top", "pressure": pressure, **held},
        ],
    }
    with Simulation.from_scene(scene) as simulation:
        simulation.run()
        p = simulation.fields.gathered("pressure")
        v = simulation.fields.gathered("fluid velocity")
    np.testing.assert_allclose(p, 3e4, rtol=1e-12)
    # Darcy's velocity of a gradient of 1e-12 of the pressure
    assert np.abs(v).max() < 1e-12 * 3e4 * 1e-5 / 1e4 / 0.3 * 10
