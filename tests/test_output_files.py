"""History, summary, expectations and progress: files that survive a kill, sentences for wrong
input.
"""

import io
import json
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc.errors import InputError, PorofsiError
from porofsi_petsc.output import progress
from porofsi_petsc.output.expectations import evaluate, failed
from porofsi_petsc.output.files import on_root, write_text
from porofsi_petsc.output.history import History, read_history
from porofsi_petsc.output.info import describe
from porofsi_petsc.output.period import Oscillation, Period
from porofsi_petsc.output.summary import (
    SUMMARY_KEYS,
    check_summary,
    summary_documentation,
    write_summary,
)

COMM = MPI.COMM_SELF
COLUMNS = ["A.u_x", "B.p"]


def history_with(directory, n_rows):
    history = History(directory, COLUMNS, COMM)
    for row in range(n_rows):
        history.append(0.1 * row, [1 / 3 * row, -1e5 * row], row)
    return history


def test_history_keeps_every_digit(tmp_path):
    history_with(tmp_path, 4).close()
    columns = read_history(tmp_path / "history.csv")
    assert list(columns) == ["t", "A.u_x", "B.p", "coupling_iterations"]
    assert np.array_equal(columns["A.u_x"], [1 / 3 * row for row in range(4)])
    assert np.array_equal(columns["t"], [0.1 * row for row in range(4)])


def test_history_is_readable_while_it_grows(tmp_path):
    history = history_with(tmp_path, 2)
    assert len(read_history(tmp_path / "history.csv")["t"]) == 2
    history.append(0.2, [0, 0], 1)
    assert len(read_history(tmp_path / "history.csv")["t"]) == 3


def test_resumed_history_is_that_of_an_uninterrupted_run(tmp_path):
    (tmp_path / "whole").mkdir()
    history_with(tmp_path / "whole", 6).close()
    history_with(tmp_path, 5).close()
    with open(tmp_path / "history.csv", "a") as file:
        file.write("0.5,0.12")  # the line that a kill tore
    assert len(read_history(tmp_path / "history.csv")["t"]) == 5
    resumed = History.resume(tmp_path, COLUMNS, COMM, 0.1 * 3)
    for row in (4, 5):
        resumed.append(0.1 * row, [1 / 3 * row, -1e5 * row], row)
    assert (tmp_path / "history.csv").read_bytes() == (
        tmp_path / "whole" / "history.csv"
    ).read_bytes()


def test_resume_without_history_starts_one(tmp_path):
    History.resume(tmp_path, COLUMNS, COMM, 1.0).append(2.0, [0, 0], 1)
    assert read_history(tmp_path / "history.csv")["t"] == [2.0]


def test_resume_refuses_other_columns(tmp_path):
    history_with(tmp_path, 1).close()
    with pytest.raises(
        InputError, match="received the columns 't,A.u_x,B.p,coupling_iterations', expected 't,C.p"
    ):
        History.resume(tmp_path, ["C.p"], COMM, 1.0)


def test_history_refuses_what_is_none(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_history(tmp_path / "history.csv")
    (tmp_path / "history.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="not a history"):
        read_history(tmp_path / "history.csv")
    with pytest.raises(ValueError, match="received 1 values, expected 2"):
        History(tmp_path, COLUMNS, COMM).append(0.0, [1.0], 1)


def test_text_is_replaced_or_left_alone(tmp_path, monkeypatch):
    path = tmp_path / "summary.json"
    write_text(path, "old")

    def killed(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", killed)
    with pytest.raises(KeyboardInterrupt):
        write_text(path, "new")
    monkeypatch.undo()
    assert path.read_text() == "old"
    write_text(path, "newer")  # the leftover .tmp is in nobody's way
    assert path.read_text() == "newer" and list(tmp_path.iterdir()) == [path]


def test_unwritable_file_is_one_sentence(tmp_path):
    with pytest.raises(PorofsiError, match="nowhere.*could not be written .No such file"):
        on_root(COMM, write_text, tmp_path / "nowhere" / "x", "text")


def full_summary():
    summary = {}
    for key in reversed(SUMMARY_KEYS):
        *levels, last = key.split(".")
        table = summary
        for level in levels:
            table = table.setdefault(level, {})
        table[last] = 1.5
    record = {
        "quantity": "A.u_y",
        "value": 1.0,
        "reference": 1.1,
        "error": 0.1,
        "passed": False,
        "reason": None,
    }
    lists = {
        "expectations": [record, {**record, "passed": None, "reason": "too short"}],
        "files": ["history.csv"],
    }
    return (
        summary
        | lists
        | {
            "neglected": {"convection": {"value": 0.1, "bound": None, "meaning": "…"}},
            "steps": np.int64(3),
        }
    )


def test_summary_is_written_in_the_documented_order(tmp_path):
    write_summary(tmp_path, full_summary())
    written = json.loads((tmp_path / "summary.json").read_text())
    assert (
        list(written)[:3] == ["scene", "title", "version"]
        and list(written["wall_time"])[-1] == "total"
    )
    assert written["steps"] == 3 and written["neglected"]["convection"]["bound"] is None
    text = describe(tmp_path / "summary.json")
    assert (
        "wall_time.total" in text
        and "1.5 s" in text
        and "FAILED" in text
        and "skipped: too short" in text
    )


def test_summary_refuses_missing_and_undocumented_keys():
    summary = full_summary()
    check_summary(summary)
    with pytest.raises(KeyError, match="undocumented .'energy.heat'"):
        check_summary(summary | {"energy": {**summary["energy"], "heat": 1.0}})
    del summary["wall_time"]["solve"]
    with pytest.raises(KeyError, match="missing .'wall_time.solve'"):
        check_summary(summary)


def test_documentation_of_the_summary_is_current():
    document = Path(__file__).parents[1] / "docs" / "summary.md"
    assert document.read_text(encoding="utf-8") == summary_documentation()


def expectation(**changes):
    values = {
        "quantity": "B.p",
        "minus": None,
        "at": None,
        "since": None,
        "statistic": None,
        "value": 1.5,
    }
    values |= {"tolerance": 0.01, "scale": None, "source": "x"}
    return SimpleNamespace(**(values | changes))


HISTORY = {"t": np.array([0.0, 1.0, 2.0]), "B.p": np.array([0.0, 2.0, -3.0])}


@pytest.mark.parametrize(
    ("changes", "value", "error", "passed"),
    [
        ({"at": 0.75}, 1.5, 0.0, True),
        ({"at": 2.0 + 1e-12, "value": -3.0}, -3.0, 0.0, True),
        ({"at": 2.0, "since": 0.5, "value": -4.0}, -4.0, 0.0, True),
        ({"statistic": "max", "value": 2.5}, 2.0, 0.2, False),
        ({"statistic": "max", "value": 2.5, "scale": 100.0}, 2.0, 0.005, True),
        ({"statistic": "min", "value": -3.0}, -3.0, 0.0, True),
        ({"statistic": "abs_max", "value": 3.0}, 3.0, 0.0, True),
        ({"statistic": "final", "value": -3.0}, -3.0, 0.0, True),
    ],
)
def test_expectation_compares_relative_to_its_scale(changes, value, error, passed):
    (record,) = evaluate([expectation(**changes)], [HISTORY])
    assert (
        record["value"] == pytest.approx(value)
        and record["error"] == pytest.approx(error)
        and record["passed"] is passed
    )
    assert bool(failed([record])) is not passed


def test_an_expectation_may_be_of_a_difference_of_two_columns():
    history = HISTORY | {"C.p": np.array([1.0, 1.0, 1.0])}
    (record,) = evaluate([expectation(minus="C.p", statistic="final", value=-4.0)], [history])
    assert (
        record["value"] == -4.0 and record["passed"] is True and record["quantity"] == "B.p - C.p"
    )


PERIOD = Period(
    0.5, 1.5, 0.01, {"B.p": Oscillation(-1.0, 2.0, 5.46), "A.u": Oscillation(3.0, 0.0, None)}
)


@pytest.mark.parametrize(
    ("statistic", "value"),
    [("period_mean", -1.0), ("period_amplitude", 2.0), ("period_max", 1.0), ("frequency", 5.46)],
)
def test_periodic_expectation_is_of_the_last_period(statistic, value):
    wrong = expectation(statistic=statistic, value=value * 1.1)
    right, missed = evaluate(
        [expectation(statistic=statistic, value=value), wrong], [HISTORY], period=PERIOD
    )
    assert right["value"] == value and right["passed"] is True
    assert missed["error"] == pytest.approx(0.1 / 1.1) and failed([right, missed]) == [missed]


@pytest.mark.parametrize(
    ("quantity", "complete", "period", "reason"),
    [
        ("B.p", True, None, "the history has no full period"),
        ("B.p", False, PERIOD, "the run did not reach its end"),
        ("A.u", True, PERIOD, "it is steady in the last period"),
    ],
)
def test_periodic_expectation_without_a_period_is_skipped(quantity, complete, period, reason):
    history = HISTORY | {"A.u": np.full(3, 3.0)}
    (record,) = evaluate(
        [expectation(quantity=quantity, statistic="frequency")], [history], complete, period
    )
    assert (record["passed"], record["value"], record["reason"]) == (None, None, reason)


def test_expectation_beyond_the_history_is_skipped():
    (record,) = evaluate([expectation(at=3.0)], [HISTORY])
    assert record["passed"] is None and "0 s to 2 s" in record["reason"] and failed([record]) == []


def test_progress_prints_few_lines_when_redirected(monkeypatch):
    now = iter(np.arange(0.0, 1000.0, 0.1))
    monkeypatch.setattr(progress.clock, "monotonic", lambda: next(now))
    stream = io.StringIO()
    display = progress.Progress(1.0, stream=stream)
    for step in range(1, 1001):
        display.update(step, step / 1000, 3)
    display.close()
    lines = stream.getvalue().splitlines()
    assert 20 <= len(lines) <= 22 and lines[-1].startswith("t = 1 s of 1 s, step 1000, 3 coupling")
    assert "left" not in lines[0] and all("left" in line for line in lines[1:])


def test_time_left_is_estimated_without_the_first_step(monkeypatch):
    """A first step of 60 s, which compiles, and nine of 2 s."""
    now = iter(np.repeat([60.0, 62.0, 64.0], 2))  # each for the estimate and for the line
    monkeypatch.setattr(progress.clock, "monotonic", lambda: next(now))
    stream = io.StringIO()
    display = progress.Progress(1.0, stream=stream)
    for step in (1, 2, 3):
        display.update(step, step / 10, 4)
    shown = stream.getvalue().splitlines()
    assert shown[0].endswith("step 1, 4 coupling iterations")
    assert [text.rsplit(", ", 1)[1] for text in shown[1:]] == ["16 s left", "14 s left"]


@pytest.mark.parametrize("choice", [{"quiet": True}, {"rank": 1}])
def test_progress_is_silent_when_asked_and_on_other_ranks(choice):
    stream = io.StringIO()
    display = progress.Progress(1.0, is_terminal=True, stream=stream, **choice)
    display.update(1, 0.5, 2)
    display.close()
    assert stream.getvalue() == ""


def test_progress_on_a_terminal_is_one_live_line():
    stream = io.StringIO()
    display = progress.Progress(1.0, is_terminal=True, stream=stream)
    display.update(1, 0.5, 2)
    display.close()
    assert "step 1" in stream.getvalue() and "50 %" in stream.getvalue()


def test_describe_refuses_what_it_does_not_know(tmp_path):
    for path, sentence in ((tmp_path / "none", "no such file"), (tmp_path, "holds no results")):
        with pytest.raises(InputError, match=sentence):
            describe(path)
    (tmp_path / "summary.json").write_text("{")
    with pytest.raises(InputError, match="not a summary"):
        describe(tmp_path / "summary.json")
