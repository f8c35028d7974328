"""Period analysis of synthetic signals: values known exactly, errors those of the sampling."""

import numpy as np
import pytest

from porofsi_petsc.errors import InputError
from porofsi_petsc.output.period import period_analysis

F, SAMPLES = 5.46, 100  # leading frequency [Hz], samples per period
SAMPLING = (
    2 * np.pi / SAMPLES
) ** 2  # 4e-3: an extremum by a parabola errs by its square, a crossing by less
T = np.arange(0, 12 / F, 1 / F / SAMPLES)


def wave(t, mean, amplitude, f=F, phase=0.3):
    return mean + amplitude * np.sin(2 * np.pi * f * t + phase)


def assert_oscillation(found, mean, amplitude, frequency, error=SAMPLING**2):
    assert found.mean == pytest.approx(mean, abs=error * amplitude)
    assert found.amplitude == pytest.approx(amplitude, rel=error)
    assert found.frequency == pytest.approx(frequency, rel=SAMPLING**1.5)


def test_every_column_has_its_mean_amplitude_and_own_frequency():
    columns = {
        "u_y": wave(T, 1.47, 34.99),
        "u_x": wave(T, -2.88, 2.72, 2 * F),
        "lift": wave(T, 2.5, 153.91, phase=2.0),
    }
    found = period_analysis(T, columns, "u_y")
    assert_oscillation(found.columns["u_y"], 1.47, 34.99, F)
    assert_oscillation(
        found.columns["u_x"], -2.88, 2.72, 2 * F, error=(4 * SAMPLING) ** 2
    )  # 50 samples per period
    assert_oscillation(found.columns["lift"], 2.5, 153.91, F)
    assert found.end - found.start == pytest.approx(1 / F, rel=SAMPLING**1.5)
    assert (
        T[-1] - found.end < 1.1 / F
    )  # a crossing counts when the signal has gone on to the edge of the band
    assert found.change < SAMPLING**2


def test_the_extrema_are_found_between_samples():
    t = np.arange(
        0, 12 / F, 1 / F / 10.3
    )  # about ten samples a period: the largest sample misses the peak by up to 5 %
    y = wave(t, 0.0, 1.0)
    found = period_analysis(t, {"y": y}, "y").columns["y"]
    assert found.amplitude == pytest.approx(
        1, abs=(2 * np.pi / 10.3) ** 4 / 24
    )  # the quartic term that the parabola leaves


def test_two_unequal_humps_per_period_count_as_two():
    y = wave(T, 0, 1, 2 * F) + wave(T, 0, 0.4, F, phase=1.0)
    found = period_analysis(T, {"lead": wave(T, 0, 1), "y": y}, "lead")
    assert found.columns["y"].frequency == pytest.approx(
        2 * F, rel=SAMPLING
    )  # whole periods: unequal spacing has no effect


@pytest.mark.parametrize("ripple", [0.02, 0.1])
def test_ripple_makes_no_crossing(ripple):
    y = wave(T, 1, 1) + wave(T, 0, ripple, 23.7 * F)
    found = period_analysis(T, {"y": y}, "y")
    assert found.end - found.start == pytest.approx(
        1 / F, rel=2 * ripple / np.pi
    )  # a crossing moves by ripple/(2π F) at each end
    assert found.columns["y"].frequency == pytest.approx(
        F, rel=0.5 * ripple / np.pi
    )  # averaged over four periods
    assert found.columns["y"].amplitude == pytest.approx(1, abs=1.01 * ripple)


def test_the_start_up_does_not_matter():
    start = 40 * np.exp(-8 * T * F / 12) * (1 + np.sin(3 * T))
    late = period_analysis(T, {"y": wave(T, 0.1, 1) + np.where(T < 6 / F, start, 0)}, "y")
    assert_oscillation(late.columns["y"], 0.1, 1, F)
    assert late.change < SAMPLING**2


def test_a_growing_amplitude_is_reported():
    growth = 1.1 ** (T * F)
    found = period_analysis(T, {"y": growth * wave(T, 0, 1)}, "y")
    assert found.change == pytest.approx(
        0.1, rel=0.01
    )  # both periods see the same factor; their limits are level crossings


def test_times_of_any_spacing():
    t = np.sort(np.random.default_rng(1).uniform(0, 12 / F, 12 * SAMPLES))
    found = period_analysis(t, {"y": wave(t, 3, 2)}, "y").columns["y"]
    error = (6 * SAMPLING) ** 1.5  # the largest gap is six times the mean one
    assert_oscillation(found, 3, 2, F, error)


def test_one_period_has_no_change():
    t = np.arange(0, 1.6 / F, 1 / F / SAMPLES)
    found = period_analysis(t, {"y": wave(t, 0, 1, phase=-0.5)}, "y")
    assert found.change is None
    assert_oscillation(found.columns["y"], 0, 1, F)


@pytest.mark.parametrize(
    "y",
    [np.zeros_like(T), 8.2e-4 + 1e-12 * np.sin(40 * T), T, 1 - np.exp(-T), wave(T, 0, 1, F / 12)],
    ids=["zero", "steady with noise of a solver", "drift", "relaxation", "one crossing"],
)
def test_no_full_period_gives_none(y):
    assert period_analysis(T, {"y": y}, "y") is None


def test_a_steady_column_has_a_mean_and_no_frequency():
    found = period_analysis(T, {"lead": wave(T, 0, 1), "y": np.full_like(T, 7.0)}, "lead").columns[
        "y"
    ]
    assert (found.mean, found.amplitude, found.frequency) == (7.0, 0.0, None)


@pytest.mark.parametrize(
    "t, columns, of, message",
    [
        (T, {"y": T}, "u_y", "no column 'u_y' to take the period of; choose from y"),
        (T, {"y": T[1:]}, "y", "column 'y' has the shape .* give one value per time"),
        (T, {"y": np.where(T > 1, np.nan, T)}, "y", "column 'y' has values that are not finite"),
        (np.zeros(3), {"y": np.arange(3)}, "y", "the times do not increase after t = 0 s"),
    ],
)
def test_wrong_input_is_one_sentence(t, columns, of, message):
    with pytest.raises(InputError, match=message):
        period_analysis(t, columns, of)
