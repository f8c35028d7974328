"""The assembly bench runs, and what it assembles converges under refinement."""

import json
import subprocess
import sys

from launching import environment

BENCH = [sys.executable, "-m", "bench.assembly"]


def records(scale, *cases):
    command = [*BENCH, "--json", "--rounds", "1", "--scale", str(scale), *cases]
    return json.loads(
        subprocess.run(
            command, env=environment(), capture_output=True, text=True, check=True
        ).stdout
    )


def test_records_have_their_fields_and_the_tangent_grows_like_the_number_of_nodes():
    """In the plane the entries of a stiffness matrix do not depend on h: its norm is that of n²
    nodes, n times a constant.
    """
    coarse, fine = (records(scale, "neo_hookean_p1")[0] for scale in (16 / 256, 32 / 256))
    assert (
        coarse["case"] == "neo_hookean_p1"
        and coarse["elements"] == 2 * 16**2
        and fine["elements"] == 2 * 32**2
    )
    assert coarse["microseconds_per_element"] > coarse["insertion_microseconds"] > 0
    # the boundary's rows are smaller, a part 4/n of all: 1/16 - 1/32 of the norm squared, times 2
    # at most
    assert abs(fine["tangent_norm"] / coarse["tangent_norm"] / 2 - 1) < 1 / 16


def test_unknown_case_is_refused():
    run = subprocess.run(
        [*BENCH, "neo_hookean_p9"], env=environment(), capture_output=True, text=True
    )
    assert run.returncode == 2 and "neo_hookean_p9" in run.stderr and "flow_t4" in run.stderr
