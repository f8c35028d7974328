"""Owners of the nodes of a graph: PT-Scotch or ParMETIS when PETSc has one, else recursive
coordinate bisection.
"""

import ctypes
import os

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

PARTITIONERS = ("ptscotch", "parmetis")
# graph partitioners need some rows on every rank; below this many nodes per rank bisection is as
# good
NODES_PER_RANK = 4


def partition(
    comm: MPI.Comm,
    indptr: np.ndarray | None,
    indices: np.ndarray | None,
    coordinates: np.ndarray | None,
) -> np.ndarray | None:
    """Return the owner of every node, (N,) int64 in 0 … size - 1, on rank 0 and None on the others;
    collective.

    indptr (N + 1,), indices : adjacency in CSR form without the diagonal; coordinates : (N, d); all
    on rank 0, else ignored. The same input on the same number of ranks gives the same owners.  A
    rank may stay without a node.
    """
    here = coordinates if comm.rank == 0 else None
    n_nodes = comm.bcast(None if here is None else len(here))
    package = next((name for name in PARTITIONERS if PETSc.Sys.hasExternalPackage(name)), None)
    if comm.size > 1 and package and n_nodes >= NODES_PER_RANK * comm.size:
        return _graph_partition(comm, package, indptr, indices, n_nodes)
    return None if here is None else coordinate_bisection(here, comm.size)


def coordinate_bisection(coordinates: np.ndarray, n_parts: int) -> np.ndarray:
    """Return the part of every point, (N,): halve the longest side of the bounding box again and
    again.

    coordinates : (N, d).  The parts differ by the rounding of the cuts; ties are broken by the
    other coordinates.
    """
    owner = np.zeros(len(coordinates), dtype=np.int64)
    pieces = [(np.arange(len(coordinates)), 0, n_parts)]
    while pieces:
        points, first, parts = pieces.pop()
        owner[points] = first
        if parts > 1 and len(points):
            axis = np.argmax(np.ptp(coordinates[points], axis=0))
            other = np.delete(coordinates[points], axis, axis=1)
            ordered = points[np.lexsort([*other.T, coordinates[points, axis]])]
            low = parts // 2
            cut = round(len(points) * low / parts)
            pieces += [(ordered[:cut], first, low), (ordered[cut:], first + low, parts - low)]
    return owner


def _graph_partition(comm, package, indptr, indices, n_nodes):
    bounds = np.arange(comm.size + 1) * n_nodes // comm.size
    rows, columns = _my_rows(comm, bounds, indptr, indices)
    size = (bounds[comm.rank + 1] - bounds[comm.rank], n_nodes)
    graph = PETSc.Mat().createAIJ(
        (size, size), csr=(rows, columns, np.ones(len(columns), PETSc.ScalarType)), comm=comm
    )
    partitioning = PETSc.MatPartitioning().create(comm)
    partitioning.setAdjacency(graph)
    partitioning.setType(package)
    partitioning.setFromOptions()
    _fix_scotch()
    owners = PETSc.IS().create(comm)
    partitioning.apply(owners)
    mine = owners.getIndices().astype(np.int64)
    whole = np.empty(n_nodes, dtype=np.int64) if comm.rank == 0 else None
    comm.Gatherv(mine, (whole, (np.diff(bounds), bounds[:-1])) if comm.rank == 0 else None)
    for petsc_object in (owners, partitioning, graph):
        petsc_object.destroy()
    return whole


def _fix_scotch():
    """Make PT-Scotch repeatable: its threads race for the random numbers, and their state survives
    from call to call.
    """
    os.environ["SCOTCH_PTHREAD_NUMBER"] = "1"
    reset = getattr(ctypes.CDLL(PETSc.__file__), "SCOTCH_randomReset", None)
    if reset is not None:
        reset()


def _my_rows(comm, bounds, indptr, indices):
    """Return the CSR rows bounds[r] … bounds[r + 1] - 1 of rank r, sent by rank 0 in PETSc's
    integers.
    """
    counts = np.empty(bounds[comm.rank + 1] - bounds[comm.rank], dtype=PETSc.IntType)
    _scatter(
        comm, np.diff(indptr).astype(PETSc.IntType) if comm.rank == 0 else None, bounds, counts
    )
    columns = np.empty(counts.sum(), dtype=PETSc.IntType)
    limits = indptr[bounds] if comm.rank == 0 else None
    _scatter(comm, indices.astype(PETSc.IntType) if comm.rank == 0 else None, limits, columns)
    return np.concatenate([[0], np.cumsum(counts)]).astype(PETSc.IntType), columns


def _scatter(comm, values, limits, mine):
    comm.Scatterv((values, (np.diff(limits), limits[:-1])) if comm.rank == 0 else None, mine)
