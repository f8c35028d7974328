"""Quantities along lines, in files of their own."""

import numpy as np
import pytest
from running import SCENES, Job, needs_mpirun, run_here, run_on

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.output.figures import make_curves
from porofsi_petsc.output.lines import read_line

COLUMN = str(SCENES / "confined_column.toml")
LINE = (
    "line=[{name='up', from=[0.125, 0.0], to=[0.125, 1.0], points=7, quantities=['p', 'u_y',"
    " 'total_yy'], every=2}]"
)
STEPS = "time={{end={}, step=0.01, rho_inf=0.5}}"


def isochrone(s, t):
    """Return the pressure over the load of a layer of 10 m under a sudden load (Terzaghi 1923)."""
    T = 1e-3 / 1e4 * (8.375e6 + 2 * 5.583e6) * t / 10.0**2
    m = (2 * np.arange(2000) + 1) * np.pi / 2
    terms = 2 / m * np.sin(m * (1 - s[:, None] / 10.0)) * np.exp(-(m**2) * T)
    return terms.sum(axis=1)


def test_the_isochrones_are_terzaghis(tmp_path):
    run_here(Job("terzaghi", str(tmp_path), ("time.end=5.0",)))
    line = read_line(tmp_path / "line_isochrones.csv")
    assert line["p"].shape == (len(line["t"]), 41)
    assert np.allclose(line["s"][0], np.linspace(0.0, 10.0, 41), rtol=0, atol=1e-12)
    later = line["t"][:, 0] > 0.5
    for t, s, p in zip(line["t"][later, 0], line["s"][later], line["p"][later], strict=True):
        error = np.abs(p / 1e4 - isochrone(s, t)).max()
        print(f"t = {t:.4g} s: largest error over the load {error:.1e}")
        assert error < 1e-3  # measured 4.7e-4 and less
    assert [path.name for path in make_curves(tmp_path)][1] == "line_isochrones.png"


def test_a_point_of_a_line_has_the_values_of_a_probe():
    with Simulation.from_scene(COLUMN, overrides=[LINE, STEPS.format(0.02)]) as simulation:
        simulation.run()
        found = simulation.lines.values("up")
        assert found["p"][0] == simulation.history["base.p"][-1]
        assert found["u_y"][-1] == simulation.history["top.u_y"][-1]


def test_a_line_is_continued_after_a_restart(tmp_path):
    changes = (LINE, "output.checkpoint_every=4")
    run_here(Job(COLUMN, str(tmp_path / "whole"), (*changes, STEPS.format(0.08))))
    part = str(tmp_path / "part")
    run_here(Job(COLUMN, part, (*changes, STEPS.format(0.04))))
    with open(tmp_path / "part" / "line_up.csv", "a", encoding="utf-8") as file:
        file.write("0.05,0,1,2,3\n0.05,0.1")  # what a run that was killed has begun
    checkpoint = f"{part}/checkpoint.h5"
    run_here(Job(COLUMN, part, (*changes, STEPS.format(0.08)), restart=checkpoint))
    texts = [(tmp_path / name / "line_up.csv").read_text() for name in ("whole", "part")]
    assert texts[0] == texts[1]


@needs_mpirun
def test_three_ranks_write_the_same(tmp_path):
    tight = (LINE, "coupling.tolerance=1e-11", STEPS.format(0.03))
    run_on(3, [Job(COLUMN, str(tmp_path / "several"), tight)], tmp_path)
    run_here(Job(COLUMN, str(tmp_path / "one"), tight))
    one, several = (read_line(tmp_path / name / "line_up.csv") for name in ("one", "several"))
    for name, values in one.items():
        assert np.allclose(several[name], values, rtol=0, atol=1e-7 * np.abs(values).max()), name


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            "line.0.to=[0.125, 2.0]",
            r"\[\[line\]\] 'up': at = .*lies outside",
        ),
        ("line.0.to=[0.125, 0.0]", "expected another"),
        ("line.0.to=[0.125, 0.0, 1.0]", "received 3 coordinates, expected 2"),
        ("line.0.points=1", "line.0.points"),
        ("line.0.points=1000000000", "expected a number <= 100000"),
        ("line.0.quantities=['vf_z']", "in a two-dimensional scene"),
    ],
)
def test_a_line_that_is_none_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        Simulation(load_scene(COLUMN, [LINE, change]))
