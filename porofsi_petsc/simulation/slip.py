"""The slip of a free flow along porous solids that a mesh does not resolve."""

from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from ..fem.boundary import interface_facets, trace
from ..fem.distribute import LocalMesh
from ..fem.domain import Domain
from ..kernels.solid import displacement_gradient
from ..materials.porous import PorousMaterial
from ..mesh.topology import locate_facets
from ..tensors import det_minus_one


class LostSlip:
    """How much of the slip velocity along porous solids is lost on a mesh, over the speed of the
    flow.

    A shear γ of the free fluid moves the surface of a bed by μ γ/Z, Z = √(μ_e D), D = μ/K the drag
    along γ: the law of Beavers and Joseph with α = √(μ_e/μ).  On cells whose nodes are s apart
    across Brinkman's layer, δ = √(μ_e/D) thick, Z is too large by √(1 + (s/δ)²/12), that of an
    endless row of linear elements; quadratic ones with the same distance of nodes are better.
    """

    def __init__(
        self, mesh: LocalMesh, materials: Mapping[str, PorousMaterial], moving_mesh: bool
    ) -> None:
        """Find the facets between free fluids and porous solids; each belongs to the rank that owns
        the first of its nodes and so has the elements on both sides (collective).
        """
        self._materials = materials
        self._moving = moving_mesh
        self._free = Domain(mesh, [r for r, m in materials.items() if m.is_free_fluid])
        self._pores = Domain(mesh, [r for r, m in materials.items() if m.has_pores])
        rows, local = interface_facets(self._free, self._pores)
        nodes = self._free.cells[rows[:, None], np.array(mesh.element.facets)[local]]
        first = nodes[np.arange(len(nodes)), mesh.natural[nodes].argmin(axis=1)]
        here = first < mesh.n_owned
        self._rows, self._local = rows[here], local[here]
        behind, _ = locate_facets(nodes[here], self._pores.cells, mesh.element)
        self._behind = behind

    def thinnest_layer(self) -> float:
        """Return the least δ of the porous solids at rest, along their most permeable axes [m]; inf
        without any (collective).
        """
        least = np.inf
        for region, span in self._pores.region_slices.items():
            drag = self._fluid(region, span).drag(np.ones((span.stop - span.start, 1))).smallest
            layer = np.sqrt(self._materials[region].viscosity / drag)
            least = min(least, layer.min(initial=np.inf))
        return self._free.mesh.comm.allreduce(float(least), MPI.MIN)

    def __call__(self, u: np.ndarray, v: np.ndarray) -> float:
        """Return the root of the mean square of the lost slip over the largest speed of the free
        flow, 0 at rest; u [m] and v [m/s], both (n_local, d) (collective).
        """
        square, area = 0.0, 0.0
        for number, nodes in enumerate(self._free.element.facets):
            here = np.flatnonzero(self._local == number)
            if not len(here):
                continue
            shear, dA, normal = self._shear(nodes, self._rows[here], u, v)
            layer, impedance = self._layers(self._behind[here], shear, u)
            spacing = self._spacing(nodes, here, normal)[:, None] / layer
            kept = 1 / np.sqrt(1 + spacing**2 / 12)
            lost = self._viscosity(self._rows[here])[:, None] * (1 - kept) / impedance
            square += float((lost**2 * (shear**2).sum(axis=-1) * dA).sum())
            area += float(dA.sum())
        return self._over_speed(square, area, v)

    def _over_speed(self, square, area, v):
        comm = self._free.mesh.comm
        square, area = comm.allreduce(np.array([square, area]))
        speed = np.linalg.norm(v[self._free.holds], axis=-1).max(initial=0.0)
        speed = comm.allreduce(float(speed), MPI.MAX)
        return float(np.sqrt(square / area) / speed) if area and speed else 0.0

    def _fluid(self, region, rows):
        """Return the fluid in the pores of some elements."""
        return self._materials[region].pore_fluid.at(self._pores.cell_numbers[rows])

    def _layers(self, behind, shear, u):
        """Return δ [m] and Z [Pa s/m] of elements with pores for flows along γ (F, Q, d), (F, Q)
        each.
        """
        size = np.linalg.norm(shear, axis=-1, keepdims=True)
        along = np.divide(shear, size, out=np.zeros_like(shear), where=size > 0)
        layer, impedance = np.empty((2, *shear.shape[:2]))
        for region, span in self._pores.region_slices.items():
            here = (behind >= span.start) & (behind < span.stop)
            fluid = self._fluid(region, behind[here])
            found = fluid.drag(self._volume_ratio(behind[here], u))
            turned = (found.turned(along[here]) * along[here]).sum(axis=-1)
            drag = found.scale * np.where(size[here, :, 0] > 0, turned, 1.0)
            layer[here] = np.sqrt(fluid.viscosity / drag)
            impedance[here] = np.sqrt(fluid.viscosity * drag)
        return layer, impedance

    def _volume_ratio(self, rows, u):
        """Return the mean J of elements with pores, (E, 1); 1 on a mesh at rest."""
        if not self._moving:
            return np.ones((len(rows), 1))
        part = self._pores.reference_stiffness.part(rows)
        H = displacement_gradient(part.G, self._pores.gather(u, rows), part.hoop)
        return 1 + det_minus_one(H).mean(axis=1, keepdims=True)

    def _viscosity(self, rows):
        """Return μ of elements of the free fluid, (F,) [Pa s]."""
        values = np.empty(len(rows))
        for region, span in self._free.region_slices.items():
            here = (rows >= span.start) & (rows < span.stop)
            values[here] = self._materials[region].viscosity
        return values

    def _shear(self, nodes, rows, u, v):
        """Return γ (F, Q, d) [1/s] on the facets of elements with the given local nodes, dA (F, Q)
        and the mean normals in the reference (F, d).
        """
        free = self._free
        X = free.mesh.X
        x = free.gather(X + u if self._moving else X, rows)
        _, G, normal = trace(free.element, nodes, x)
        dA = np.linalg.norm(normal, axis=-1)
        n = normal / dA[..., None]
        grad = np.swapaxes(free.gather(v, rows), 1, 2)[:, None] @ G
        drawn = ((grad + np.swapaxes(grad, 2, 3)) @ n[..., None])[..., 0]
        along = drawn - (drawn * n).sum(axis=-1, keepdims=True) * n
        _, _, at_rest = trace(free.element, nodes, free.gather(X, rows))
        return along, dA, at_rest.mean(axis=1)

    def _spacing(self, nodes, here, normal):
        """Return the distance of the nodes across the elements behind the facets, (F,) [m]."""
        X = self._free.mesh.X
        n = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        facet = X[self._free.cells[self._rows[here]][:, list(nodes)]].mean(axis=1)
        behind = X[self._pores.cells[self._behind[here]]] - facet[:, None]
        depth = (behind @ n[..., None])[..., 0].max(axis=1)
        return depth / self._free.element.order
