"""The drag of a pore fluid at the nodes: its size, and what it carries along of the fluid.

Numbers of the nodes (n,), or tensors (n, d, d) where a permeability has principal axes.
"""

import math

import numpy as np

from ..fem.domain import Configuration, Domain
from ..materials.porous import PorousMaterial
from ..tensors import scaled_identity
from .coupling_data import Rates

Materials = dict[str, PorousMaterial]


def product(nodal: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return numbers (n,) or tensors (n, d, d) times vectors (n, d)."""
    if nodal.ndim == 1:
        return nodal[:, None] * vectors
    return np.einsum("nij,nj->ni", nodal, vectors)


def drag_weight(domain: Domain, materials: Materials, configuration: Configuration) -> np.ndarray:
    """Return ∫ |S_ij| dV of the elements of a node, each in equal parts to its nodes, (n_owned,)
    or (n_owned, d, d) [N s/m].
    """

    def weight(material, J, span):
        return np.abs(material.drag(J).times(configuration.geometry.dV[span]).plus(0.0))

    values = _at_points(domain, materials, configuration, weight)
    return _nodal_sum(domain, values.sum(axis=1) / domain.cells.shape[1])


def dragged_part(
    domain: Domain,
    materials: Materials,
    configuration: Configuration,
    rates: Rates,
    free: np.ndarray,
) -> np.ndarray:
    """Return χ, δv_f = χ δv_s of what the drag does to the fluid, the mean of a node's elements,
    0 without any, (n_local,), or (n_local, d, d) (collective).

    The tensors fulfil (S + ρ_f c_f) δv_f = S δv_s in the components of v_f that are free (n_local,
    d): those that are held keep the others from moving with the skeleton.
    """

    def density(material, J):
        return material.fluid_density(J)

    def fraction(material, J, span):
        return rates.dragged_fraction(material.drag(J), density(material, J))

    def force(material, J, span):
        return material.drag(J).plus(0.0)

    def force_and_inertia(material, J, span):
        return material.drag(J).plus(density(material, J) * rates.c_f)

    def mean(values):
        values = _at_points(domain, materials, configuration, values).mean(axis=1)
        ones = _nodal_sum(domain, np.ones(domain.n_cells))
        total = _nodal_sum(domain, values)
        count = np.maximum(ones, 1.0).reshape(-1, *(1,) * (total.ndim - 1))
        return domain.mesh.halo.extend(total / count)

    if not _have_axes(materials):
        return mean(fraction)
    right = np.where(free[:, :, None], mean(force), 0.0)
    left = np.where(free[:, :, None] & free[:, None, :], mean(force_and_inertia), 0.0)
    size = np.maximum(left.max(axis=(1, 2)), 1.0)
    left += (size[:, None] * ~free)[..., None] * np.eye(domain.dim)
    return np.linalg.solve(left, right)


def _have_axes(materials):
    return any(material.anisotropy for material in materials.values())


def _at_points(domain, materials, configuration, of):
    """Return values of (material, J, rows) at the points of all elements, (E, Q), or tensors (E,
    Q, d, d).
    """
    tensors = _have_axes(materials)
    J = configuration.J
    values = np.empty((*J.shape, *(domain.dim,) * 2) if tensors else J.shape)
    for region, span in domain.region_slices.items():
        here = of(materials[region].at(domain.cell_numbers[span]), J[span], span)
        values[span] = scaled_identity(here, domain.dim) if here.ndim < values.ndim else here
    return values


def _nodal_sum(domain, values):
    """Return the sum of element values (E, ...) over the elements of a node, (n_owned, ...)."""
    rows = values.reshape(len(values), 1, math.prod(values.shape[1:]))
    vectors = np.broadcast_to(rows, (*domain.cells.shape, rows.shape[2]))
    return domain.scatter_add(vectors).reshape(-1, *values.shape[1:])
