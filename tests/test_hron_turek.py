"""The channel scenes of Turek and Hron: a period that a run finds, published rows that fit the
scenes, limits of a sequence.
"""

import pytest
from running import Job, run_here
from study import hron_turek as study

from porofsi_petsc import load_scene

FREQUENCY = 1.0995  # [Hz], of CSM3, Featflow
STEP = 0.01  # [s], 91 a period


def test_a_swinging_beam_has_its_period_in_summary_and_log(tmp_path):
    summary = run_here(
        Job(
            "hron_turek_csm3",
            str(tmp_path),
            (f"time.step={STEP}", "time.end=1.7", "output.fields_every=1000"),
        )
    )
    period = summary["period"]
    tip = period["columns"]["A.u_y"]
    # One period: the second mode, 1.4 % of the tip's motion, moves both crossings by up to 0.014/2π
    # of it; 0.2 % by the step.
    assert tip["frequency"] == pytest.approx(FREQUENCY, rel=0.007)
    assert period["end"] - period["start"] == pytest.approx(1 / FREQUENCY, rel=0.007)
    assert tip["mean"] == pytest.approx(
        -tip["amplitude"], rel=0.03
    )  # from rest without loss: it comes back to 0 and no further
    log = (tmp_path / "run.log").read_text()
    assert f"last period of A.u_y: {period['start']:.6g} s to {period['end']:.6g} s" in log
    assert f"A.u_y: {tip['mean']:.6g} +- {tip['amplitude']:.6g}, {tip['frequency']:.5g} Hz" in log


def test_every_published_row_has_its_expectation():
    for case in ("cfd1", "cfd2", "cfd3", "csm1", "csm2", "fsi1", "fsi2", "fsi3"):
        expected = {study.quantity(e) for e in load_scene(f"hron_turek_{case}").expect}
        rows = study.published(case)
        assert len(rows) >= 3 and all(values.keys() <= expected for values in rows.values())


def test_the_reference_is_the_limit_of_the_published_rows():
    # The finest published row and the value the scene expects are the same number, or one more
    # refinement apart (CSM: 2e-5).
    for case in ("cfd1", "cfd2", "cfd3", "csm1", "csm2", "fsi1", "fsi2", "fsi3"):
        finest = list(study.published(case).values())[-1]
        for e in load_scene(f"hron_turek_{case}").expect:
            if study.quantity(e) in finest:
                assert study.error(finest[study.quantity(e)], e) < 5e-5


def test_order_and_limit_of_halved_sizes():
    q, limit = study.limits([9.0, *(2.0 + 3.0 * 0.5 ** (1.5 * level) for level in range(3))])
    assert q == pytest.approx(1.5) and limit == pytest.approx(2.0)
    assert (
        study.limits([1.0, 2.0])
        == study.limits([1.0, 2.0, 1.5])
        == study.limits([1.0, 2.0, 4.0])
        == (None, None)
    )
