"""The bench of the growth over unknowns and ranks: its runs, its cases, its report."""

import json
import subprocess
import sys

import pytest
from bench.scale import CASES, COLUMNS, KEYS, block, study
from running import environment, needs_mpirun


@needs_mpirun
def test_a_run_on_two_ranks_has_all_columns():
    command = [
        sys.executable,
        "-m",
        "bench.scale",
        "porous",
        "--unknowns",
        "2000",
        "--ranks",
        "2",
        "--json",
    ]
    run = subprocess.run(command, capture_output=True, text=True, env=environment(), timeout=120)
    (record,) = json.loads(run.stdout)
    assert set(record) == {*KEYS, *COLUMNS} and record["ranks"] == 2
    assert (
        record["raw_bytes_per_unknown"] > record["peak_bytes_per_unknown"] > 0 < record["share"] < 1
    )


@pytest.mark.parametrize("unknowns", [10_000, 500_000, 2_000_000])
def test_the_block_has_about_the_unknowns_asked_for(unknowns):
    cells = [json.loads(key.partition("=")[2]) for key in block(unknowns)]
    nodes = 1
    for axis in cells:
        nodes *= sum(axis) + 1
    assert abs(7 * nodes / unknowns - 1) < 0.15  # half a cell along each side of ten


def test_the_study_has_each_run_once():
    runs = study("porous")
    assert (
        len(runs) == len(set(runs))
        and {run.case for run in runs} == {"porous"}
        and set(CASES) >= {"porous", "fsi"}
    )
