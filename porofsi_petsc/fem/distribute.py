"""The mesh of one rank: its own nodes, every cell that touches one of them, and the ghost nodes of
these cells.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from mpi4py import MPI

from ..elements import ELEMENTS, Element
from ..mesh import Mesh
from ..mesh.topology import locate_facets
from .halo import Halo
from .natural_order import NaturalOrder

TAG = 72
FACET_ARRAYS = ("nodes", "cells", "local", "owned")


@dataclass(frozen=True, eq=False)
class Facets:
    """The facets of one tag that belong to a local cell.

    nodes : (F, Af) local nodes, outward.  cells : (F,) local cell.  local : (F,) which facet of the
    cell.
    owned : (F,) bool, true on exactly one rank.
    """

    nodes: np.ndarray
    cells: np.ndarray
    local: np.ndarray
    owned: np.ndarray


@dataclass(frozen=True, eq=False)
class LocalMesh:
    """The part of the mesh on one rank, owned nodes first (ascending natural number), then ghosts
    (by owner and natural number).

    natural, numbering : (n_local,) natural and PETSc node numbers; the rank owns first … first +
    n_owned - 1.
    X : (n_local, d) [m].  cells : (E, A) local nodes.  cell_owned : (E,) bool, true on exactly one
    rank.
    cell_natural : (E,) ascending number in the serial mesh.  cell_region : (E,) index into regions.
    facets : tag -> Facets, the same tags on every rank; inner : region -> those that other regions
    have toward it, as in the serial mesh.  notes : of the serial mesh.  values : name
    -> (E,) numbers of cells that a mesh file gives.  placed : (E, A, d) displacement [m] at which
    the nodes of a cell were when it was placed, zero of cells from the start, None where nothing is
    placed in the run; finite : whether a placed cell has the shape that it had then, else that of
    the mesh, from which infinitesimal displacements do not lead away.
    """

    comm: MPI.Intracomm
    element: Element
    n_owned: int
    n_global: int
    first: int
    natural: np.ndarray
    numbering: np.ndarray
    X: np.ndarray
    cells: np.ndarray
    cell_owned: np.ndarray
    cell_natural: np.ndarray
    n_cells_global: int
    regions: tuple
    cell_region: np.ndarray
    facets: dict
    halo: Halo
    order: NaturalOrder
    hash: str
    notes: tuple
    values: dict
    inner: dict = field(default_factory=dict)
    placed: np.ndarray | None = None
    finite: bool = False

    @property
    def dim(self) -> int:
        """Return the space dimension."""
        return self.element.dim

    @property
    def n_local(self) -> int:
        """Return the number of owned and ghost nodes."""
        return len(self.natural)

    @cached_property
    def cell_order(self) -> NaturalOrder:
        """Return the exchange of rows of all cells of the rank, (E, ...), with slabs of the natural
        order (collective when first asked for).
        """
        return NaturalOrder(self.comm, self.cell_natural, self.n_cells_global)


def distribute(comm: MPI.Intracomm, mesh: Mesh | None, owner: np.ndarray | None) -> LocalMesh:
    """Return the LocalMesh of every rank; collective.

    mesh : mesh.Mesh, owner : (N,) rank of every node; both on rank 0 and ignored elsewhere.
    """
    header, mine = (
        _send_parts(comm, mesh, owner)
        if comm.rank == 0
        else (comm.bcast(None), _receive_part(comm))
    )
    first = header.pop("first")
    tags = header.pop("tags")
    inner = header.pop("inner")
    values = {name: mine.pop(f"values.{name}") for name in header.pop("values")}
    element = ELEMENTS[header.pop("element")]
    n_owned = int(first[comm.rank + 1] - first[comm.rank])
    groups = [
        Facets(*(mine.pop(f"{index}.{name}") for name in FACET_ARRAYS))
        for index in range(len(tags) + len(inner))
    ]
    return LocalMesh(
        comm=comm,
        element=element.around_axis() if header.pop("axisymmetric") else element,
        n_owned=n_owned,
        first=int(first[comm.rank]),
        facets=dict(zip(tags, groups, strict=False)),
        inner=dict(zip(inner, groups[len(tags) :], strict=True)),
        values=values,
        halo=Halo(comm, n_owned, mine["numbering"][n_owned:], first),
        order=NaturalOrder(comm, mine["natural"][:n_owned], header["n_global"]),
        **header,
        **mine,
    )


def _send_parts(comm, mesh, owner):
    """Send every rank its part, one at a time, and return the header and the part of rank 0."""
    cutter = _Cutter(mesh, owner, comm.size)
    header = comm.bcast(cutter.header)
    for rank in range(1, comm.size):
        part = cutter.part(rank)
        comm.send([(name, array.shape, array.dtype.str) for name, array in part.items()], rank, TAG)
        for array in part.values():
            comm.Send(array, rank, TAG)
    return header, cutter.part(0)


def _receive_part(comm):
    part = {
        name: np.empty(shape, dtype=dtype) for name, shape, dtype in comm.recv(source=0, tag=TAG)
    }
    for array in part.values():
        comm.Recv(array, 0, TAG)
    return part


class _Cutter:
    """What rank 0 needs to cut out the part of any rank."""

    def __init__(self, mesh, owner, size):
        self._mesh = mesh
        self._owner = np.asarray(owner, dtype=np.int64)
        first = np.searchsorted(np.sort(self._owner), np.arange(size + 1))
        self._nodes = np.argsort(self._owner, kind="stable")
        self._numbering = np.empty(len(owner), dtype=np.int64)
        self._numbering[self._nodes] = np.arange(len(owner))
        self._first = first
        n_cells = len(mesh.cells)
        touches = np.unique(self._owner[mesh.cells] * n_cells + np.arange(n_cells)[:, None])
        self._cells = np.split(
            touches % n_cells, np.searchsorted(touches, np.arange(1, size) * n_cells)
        )
        self._facets = [
            _FacetsByCell(nodes, *locate_facets(nodes, mesh.cells, mesh.element))
            for nodes in mesh.facets.values()
        ]
        self._facets += [self._toward(name, nodes) for name, nodes in mesh.inner.items()]
        self.header = {
            "element": mesh.element.name,
            "axisymmetric": mesh.element.axisymmetric,
            "first": first,
            "tags": list(mesh.facets),
            "inner": list(mesh.inner),
            "regions": tuple(mesh.regions),
            "n_global": len(mesh.points),
            "n_cells_global": n_cells,
            "hash": mesh.hash,
            "notes": mesh.notes,
            "values": list(mesh.values),
        }

    def _toward(self, region, nodes):
        """Return facets with the cells behind them that are not of a region."""
        mesh = self._mesh
        others = np.flatnonzero(mesh.cell_region != mesh.regions.index(region))
        cell, local = locate_facets(nodes, mesh.cells[others], mesh.element)
        return _FacetsByCell(nodes, others[cell], local)

    def part(self, rank):
        """Return the arrays of a rank, dict name -> array; the arrays of facet group i are called
        "i.nodes", ...
        """
        mesh = self._mesh
        chosen = self._cells[rank]
        owned = self._nodes[self._first[rank] : self._first[rank + 1]]
        touched = np.unique(mesh.cells[chosen])
        ghosts = touched[self._owner[touched] != rank]
        natural = np.concatenate([owned, ghosts[np.argsort(self._numbering[ghosts])]])
        to_local = _Renumbering(natural)
        cell_owned = self._owner[mesh.cells[chosen, 0]] == rank
        part = {
            "natural": natural,
            "numbering": self._numbering[natural],
            "X": mesh.points[natural],
            "cells": to_local(mesh.cells[chosen]),
            "cell_owned": cell_owned,
            "cell_natural": chosen,
            "cell_region": np.asarray(mesh.cell_region, dtype=np.int64)[chosen],
        }
        part |= {f"values.{name}": values[chosen] for name, values in mesh.values.items()}
        for index, facets in enumerate(self._facets):
            here = facets.of(chosen)
            cells = np.searchsorted(chosen, facets.cell[here])
            arrays = (to_local(facets.nodes[here]), cells, facets.local[here], cell_owned[cells])
            part |= {
                f"{index}.{name}": array for name, array in zip(FACET_ARRAYS, arrays, strict=True)
            }
        return {name: np.ascontiguousarray(array) for name, array in part.items()}


class _FacetsByCell:
    """The facets of one tag, nodes (F, Af), cell and local (F,), found by their cells: a part costs
    what it holds.
    """

    def __init__(self, nodes, cell, local):
        self.nodes = nodes
        self.cell = cell
        self.local = local
        self._order = np.argsort(cell, kind="stable")
        self._sorted = cell[self._order]

    def of(self, chosen):
        """Return the facets of some cells, ascending; chosen : (n,) ascending cells."""
        first, end = (np.searchsorted(self._sorted, chosen, side) for side in ("left", "right"))
        counts = end - first
        places = np.repeat(end - np.cumsum(counts), counts) + np.arange(counts.sum())
        return np.sort(self._order[places])


class _Renumbering:
    """The map from natural to local node numbers, of the size of the part."""

    def __init__(self, natural):
        self._order = np.argsort(natural)
        self._sorted = natural[self._order]

    def __call__(self, nodes):
        return self._order[np.searchsorted(self._sorted, nodes)]
