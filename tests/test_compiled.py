"""Compiled loops: one compilation for every kind of array, NaN passes through, machine code is kept
and found again.
"""

import os
import subprocess
import sys

import numpy as np
import pytest

from porofsi_petsc.compiled import plain
from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.fem.geometry import Rule, geometry
from porofsi_petsc.kernels import solid
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.tensors import invert

CACHED = """
import numpy as np
from porofsi_petsc import tensors
tensors.det(np.eye(2)[None])
loop = tensors._det_loop(2).compiled
print(sum(loop.stats.cache_hits.values()), sum(loop.stats.cache_misses.values()))
"""


def test_plain_takes_arrays_that_are_read_only_broadcast_or_integer():
    for array in (
        np.broadcast_to(1.5, (3, 2)),
        np.arange(6).reshape(2, 3).T,
        np.ones((2, 2))[:, ::-1],
    ):
        made = plain(array)
        assert made.dtype == np.float64 and made.flags.c_contiguous and made.flags.writeable
        assert np.array_equal(made, array)


def test_a_part_of_loops_is_not_called_from_python():
    """It has no entry for it: without the refusal the process would end."""
    with pytest.raises(TypeError, match="invert is a part of compiled loops"):
        invert(2, np.eye(2), np.empty((2, 2)))


@pytest.mark.parametrize("name", ELEMENTS)
def test_nan_of_one_element_is_seen_there_and_nowhere_else(name):
    element = ELEMENTS[name]
    law = ELASTIC["neo_hookean"](lam=1.7, mu=0.8)
    X = np.broadcast_to(element.node_coordinates, (3, element.nodes, element.dim))
    reference = geometry(Rule.of(element, 2), X)
    u = np.zeros(X.shape)
    u[1] = np.nan
    for vectors in (
        solid.stress_residual(reference.G, reference.dV, law, u),
        solid.stress_tangent(reference.G, reference.dV, law, u),
    ):
        seen = np.isnan(vectors.reshape(3, -1)).any(axis=1)
        assert seen.tolist() == [False, True, False]


def started(cache):
    """Return a process that calls a compiled loop once and prints how often its code was read and
    made.
    """
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    return subprocess.Popen(
        [sys.executable, "-c", CACHED], env=environment, stdout=subprocess.PIPE, text=True
    )


def counts(process):
    """Return how often a process that `started` has read and made machine code."""
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    return [int(word) for word in output.split()]


def test_machine_code_is_read_by_the_next_process(tmp_path):
    assert [counts(started(tmp_path)) for _ in range(2)] == [[0, 1], [1, 0]]


def test_a_first_run_knows_that_it_compiles(tmp_path):
    code = "from porofsi_petsc.compiled import compilation_notice; print(compilation_notice())"

    def notice(folder):
        environment = os.environ | {"NUMBA_CACHE_DIR": str(folder)}
        return subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    assert f"kept in {tmp_path}" in notice(tmp_path)
    counts(started(tmp_path))
    assert notice(tmp_path).strip() == ""
    assert "/proc/cache" in notice("/proc/cache") and "cannot be written" in notice("/proc/cache")


def test_of_processes_that_start_together_one_compiles(tmp_path):
    together = [started(tmp_path) for _ in range(3)]
    assert sorted(counts(process) for process in together) == [[0, 1], [1, 0], [1, 0]]


def test_without_a_place_to_write_it_compiles_for_itself():
    """/proc takes no folder, from root neither."""
    assert [counts(started("/proc/cache")) for _ in range(2)] == [[0, 1], [0, 1]]


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_a_damaged_file_of_the_cache_is_no_obstacle(tmp_path, kind):
    """As a full disk or a power cut leaves it: index or machine code cut short."""
    counts(started(tmp_path))
    for file in tmp_path.rglob(f"*.{kind}"):
        file.write_bytes(file.read_bytes()[: 0 if kind == "nbi" else 50])
    assert [counts(started(tmp_path)) for _ in range(2)] == [[0, 1], [1, 0]]
