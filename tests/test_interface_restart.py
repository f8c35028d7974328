"""Over an interface: a run that goes on from its checkpoint is the uninterrupted one, and ranks do not matter."""

from pathlib import Path

import numpy as np
import pytest
from running import SCENES, Job, history, largest_difference, needs_mpirun, run_here, run_on, state

FLAP = str(SCENES / "flap.toml")
SHORT = ("output.checkpoint_every=5", "time.end=0.1", "material.0.fluid.density=200.0")
ACCELERATORS = ("constant", "aitken", "anderson", "iqn_ils")
CASES = {name: (f"coupling.accelerator={name}",) for name in ACCELERATORS} | {
    "none": ("coupling.accelerator=none", "material.0.fluid.density=20.0"),
    "newton": ("coupling.tangent=newton",),
    "neo-Hookean mesh": ("mesh_motion.law=neo_hookean",),
    "weak": ("coupling.scheme=weak", "material.0.fluid.density=1.0"),
    "one-way": ("coupling.scheme=one_way",),
    "Robin-Neumann": ("coupling.interface=robin_neumann",),
    "Robin-Robin": ("coupling.interface=robin_robin",),
    "quasi-direct": ("coupling.scheme=quasi_direct",),
    "direct": ("coupling.scheme=direct",),
    "quadratic": ("mesh.order=2", "mesh.x.cells=[2, 1, 3]", "mesh.y.cells=[2, 2]"),
    "growing steps": ("time.growth=1.1", "time.max_step=0.02"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_run_continued_in_its_middle_is_the_whole_one(case, tmp_path):
    """To the last bit of every row and of the state: lagged tangents, reused vectors, mesh and forces are in the checkpoint."""
    whole, half = tmp_path / "whole", tmp_path / "half"
    run_here(Job(FLAP, str(whole), (*SHORT, *CASES[case])))
    middle = history(whole)["t"][5]
    run_here(Job(FLAP, str(half), (*SHORT, *CASES[case], f"time.end={middle}")))
    run_here(Job(FLAP, str(half), (*SHORT, *CASES[case]), restart=str(half / "checkpoint.h5")))
    assert (whole / "history.csv").read_text() == (half / "history.csv").read_text()
    expected, computed = state(whole / "checkpoint.h5"), state(half / "checkpoint.h5")
    assert expected.keys() == computed.keys() and {"mesh.u", "fluid.force", "solid.u"} <= expected.keys()
    assert [name for name in expected if not np.array_equal(expected[name], computed[name])] == []


RANKS = {
    "iqn_ils, neo-Hookean mesh": ("coupling.accelerator=iqn_ils", "mesh_motion.law=neo_hookean"),
    "Robin-Neumann": ("coupling.interface=robin_neumann",),
    "direct": ("coupling.scheme=direct",),
}
# The solutions of different numbers of ranks differ by round-off, the sweeps end at residuals of 1e-10 times a condition of some
# hundreds.
SAME = 1e-7


@needs_mpirun
def test_ranks_do_not_matter(tmp_path):
    """On 1, 2 and 3 ranks; of three one has no node of the solid."""
    jobs = {}
    for ranks in (1, 2, 3):
        folder = tmp_path / str(ranks)
        tight = "coupling.tolerance=1e-10", "time.end=0.03", "output.checkpoint_every=3", "material.0.fluid.density=200.0"
        jobs[ranks] = [Job(FLAP, str(folder / name), (*tight, *options)) for name, options in RANKS.items()]
        if ranks > 1:
            run_on(ranks, jobs[ranks], tmp_path)
    for job in jobs[1]:
        run_here(job)
    for ranks in (2, 3):
        for mine, serial in zip(jobs[ranks], jobs[1], strict=True):
            a, b = (Path(job.directory) for job in (mine, serial))
            rows, expected = history(a), history(b)
            found = {name: largest_difference(rows[name], expected[name]) for name in expected if name != "coupling_iterations"}
            arrays, others = state(a / "checkpoint.h5"), state(b / "checkpoint.h5")
            # A sweep more or less, and a lagged tangent is renewed in another step; vectors are reused as many as there were.
            fields = [name for name in others if "tangent" not in name and not name.startswith("accelerator")]
            found |= {name: largest_difference(arrays[name], others[name]) for name in fields}
            worst = max(found, key=found.get)
            print(f"{ranks} ranks, {b.name}: largest difference {found[worst]:.1e} in {worst}")
            assert found[worst] < SAME
