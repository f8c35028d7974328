"""Selection of the tests by the number of ranks; a failure on one rank ends the parallel job
instead of hanging it.
"""

import os
import sys

import pytest

RANKS = int(
    next((os.environ[key] for key in ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE") if key in os.environ), 1)
)


def pytest_collection_modifyitems(config, items):
    """Keep only the tests marked mpi when there is more than one rank."""
    if RANKS > 1:
        serial = [item for item in items if not item.get_closest_marker("mpi")]
        items[:] = [item for item in items if item.get_closest_marker("mpi")]
        config.hook.pytest_deselected(items=serial)


def pytest_runtest_logreport(report):
    """Abort all ranks when one fails, because the others wait for it in a collective call."""
    if RANKS > 1 and report.failed:
        from mpi4py import MPI

        print(
            f"\nrank {MPI.COMM_WORLD.rank} of {RANKS}: {report.nodeid}"
            f" failed\n{report.longreprtext}",
            file=sys.stderr,
            flush=True,
        )
        MPI.COMM_WORLD.Abort(1)


@pytest.fixture(scope="module")
def petsc():
    """Start PETSc without options of a user."""
    from porofsi_petsc.linalg.options import start

    start()


@pytest.fixture
def shared_path(tmp_path):
    """Return one temporary folder that all ranks see."""
    from mpi4py import MPI

    return MPI.COMM_WORLD.bcast(tmp_path)
