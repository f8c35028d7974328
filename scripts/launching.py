"""Ranks started by a bench, a fuzzer or a test, with Open MPI and with MPICH: the environment they
get and their processes.
"""

import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OF_MPI = ("OMPI_", "PMIX_", "PMI_", "ORTE_", "PRTE_", "MPI_LOCAL", "HYDI_", "HYDRA_")
LAUNCH = {
    "OMP_NUM_THREADS": "1",
    # Open MPI 4 and 5 as root, with more ranks than cores; MPICH needs and reads none of these.
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "PRTE_MCA_hwloc_default_binding_policy": "none",
}
# A rank that waits leaves its core to the others: not for measured times.
GIVE_WAY = {"OMPI_MCA_mpi_yield_when_idle": "1"}


def environment():
    """Return the environment without what MPI has put there, so that mpirun starts afresh, and with
    this checkout's modules.
    """
    kept = {key: value for key, value in os.environ.items() if not key.startswith(OF_MPI)}
    path = os.pathsep.join(filter(None, [str(ROOT), str(ROOT / "scripts"), kept.get("PYTHONPATH")]))
    return kept | LAUNCH | {"PYTHONPATH": path}


def ranks_of(launcher):
    """Return the ids of the processes below that of mpirun which have none below them, ascending.

    MPICH's has one process between itself and the ranks.
    """
    found = subprocess.run(
        ["ps", "-e", "-o", "pid=,ppid="], capture_output=True, text=True, check=True
    )
    below = {}
    for line in found.stdout.splitlines():
        pid, parent = map(int, line.split())
        below.setdefault(parent, []).append(pid)
    leaves, inner = [], [launcher]
    while inner:
        for pid in below.get(inner.pop(), ()):
            (inner if pid in below else leaves).append(pid)
    return sorted(leaves)
