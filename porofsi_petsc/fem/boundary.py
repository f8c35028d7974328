"""Boundary data on the nodes and facets of a rank: prescribed values and surface loads."""

from dataclasses import dataclass

import numpy as np

from ..elements.simplex import FACET
from ..kernels.surface import facet_measure, surface_load
from .geometry import Rule


@dataclass(frozen=True)
class Prescribed:
    """Essential values of one component on owned nodes: nodes (n,), component, expression(t, x) -> (n,)."""

    nodes: np.ndarray
    component: int
    expression: object


class Dirichlet:
    """The essential conditions of one nodal field with k components.

    mask : (n_local, k) bool, true where a value is prescribed, ghosts included
    """

    def __init__(self, mesh, components, entries):
        """Collect the conditions; entries : (tag, component, expression) with an expression of (t, x)."""
        self._mesh = mesh
        self.conditions = [Prescribed(owned_nodes(mesh, tag), component, expression) for tag, component, expression in entries]
        self.mask = np.zeros((mesh.n_local, components), dtype=np.uint8)
        for condition in self.conditions:
            self.mask[condition.nodes, condition.component] = 1
        mesh.halo.update(self.mask)
        self.mask = self.mask.astype(bool)

    def apply(self, field, t):
        """Overwrite the prescribed entries of a field (n_local, k) by their values at time t, ghosts included (collective)."""
        for condition in self.conditions:
            field[condition.nodes, condition.component] = condition.expression(t, self._mesh.X[condition.nodes])
        self._mesh.halo.update(field)

    def free(self, owned):
        """Return a copy of (n_owned, k) with the prescribed entries set to zero."""
        return np.where(self.mask[: self._mesh.n_owned], 0.0, owned)


class SurfaceLoad:
    """A vector of nodal loads ∮ N_a t dA from expressions per component on one tagged surface of the reference configuration."""

    def __init__(self, mesh, tag, expressions):
        """Prepare the facets; expressions : dict component -> expression(t, x), units of the load per reference area."""
        facet = FACET[mesh.element.name]
        self._rule = Rule.of(facet, 2 * mesh.element.order + 1)
        self._nodes = mesh.facets[tag].nodes
        coordinates = mesh.X[self._nodes]
        self._dA = facet_measure(self._rule.dN, self._rule.weights, coordinates)
        self._points = (self._rule.N @ coordinates).reshape(-1, mesh.dim)
        self._expressions, self._n_owned = expressions, mesh.n_owned

    def add_to(self, loads, t):
        """Add the loads at time t to a field (n_owned, k)."""
        owned = self._nodes < self._n_owned
        for component, expression in self._expressions.items():
            values = expression(t, self._points).reshape(self._dA.shape)
            nodal = surface_load(self._rule.N, self._dA, values[..., None])[..., 0]
            loads[:, component] += np.bincount(self._nodes[owned], weights=nodal[owned], minlength=self._n_owned)


def owned_nodes(mesh, tag):
    """Return the owned nodes that lie on a tagged surface, sorted."""
    nodes = np.unique(mesh.facets[tag].nodes)
    return nodes[nodes < mesh.n_owned]


def facet_normals(mesh, tag):
    """Return the outward unit normals of the facets of a tag at their centroid, (F, d), reference configuration."""
    facet = FACET[mesh.element.name]
    centroid = np.full((1, mesh.dim - 1), 1 / mesh.dim)
    tangents = np.swapaxes(mesh.X[mesh.facets[tag].nodes], 1, 2) @ facet.gradient(centroid)[0]
    if mesh.dim == 2:
        normal = np.column_stack([tangents[:, 1, 0], -tangents[:, 0, 0]])
    else:
        normal = np.cross(tangents[..., 0], tangents[..., 1])
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)
