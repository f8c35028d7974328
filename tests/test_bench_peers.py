"""scripts/run bench peers: what it measures of ours and reads of a peer."""

import sys

import numpy as np
import pytest
from bench import peers


def test_a_run_of_ours_has_its_error_and_its_time():
    """A strip of quadratic elements is within the 1.5e-3 that the page compares at; exact:
    Terzaghi's series.
    """
    row, history = peers.own_row("strip", peers.terzaghi()["P2 1 x 5"])
    print(row)
    assert 1e-4 < row["error"] < 1.5e-3
    assert row["steps"] < 20 and row["unknowns"] == 165 and 0 < row["seconds"] < row["process"]
    assert history["t"][-1] == pytest.approx(90.0)


def test_the_error_of_p_is_over_the_exact_one():
    """At T_v = 0.1 the exact series integrates to |p| = 0.783 |p_0|, here by quadrature of p
    itself.
    """
    z = (np.arange(4000) + 0.5) / 4000
    k = (2 * np.arange(400) + 1) * np.pi / 2
    p = (2 / k * np.exp(-(k**2) * peers.DEGREE)) @ np.sin(np.outer(k, z))
    size = np.sqrt((p**2).mean())
    summary = {"errors": [{"p": 0.01}]}
    assert peers.pressure_error(summary, None) == pytest.approx(0.01 / size, rel=1e-6)


def test_a_peer_says_its_measures():
    """KEY=VALUE of a line, or JSON."""
    command = (
        f"{sys.executable} -c \"print('X dofs=867 steps=100 loop_wall=0.76 errL2_p=1.49e-3')\""
    )
    row = peers.peer_row("X", command, None)
    assert (row["unknowns"], row["steps"], row["seconds"], row["error"]) == (
        867,
        100,
        0.76,
        1.49e-3,
    )
    assert (
        peers.peer_row("Y", f'{sys.executable} -c "print(\'{{\\"total_s\\": 3.5}}\')"', None)[
            "seconds"
        ]
        == 3.5
    )


def test_the_history_of_a_peer_gives_its_error(tmp_path):
    """An amplitude 10 % above the reference."""
    script = tmp_path / "peer.py"
    script.write_text(
        "from math import sin\nfor i in range(2000):\n    t = 1e-3 * i; print(f't={t:.3f} ux=0.0"
        f" uy={{{1.1 * peers.FSI3} * sin(34 * t):.6e}} drag=1.0 lift=2.0')\n"
    )
    row = peers.peer_row("Z", f"{sys.executable} {script}", peers.swing_error)
    assert row["error"] == pytest.approx(
        0.1, abs=1e-4
    )  # the sampled extremes are within 34² dt²/8 = 1.4e-4 of the true ones


def test_a_failing_peer_is_named():
    with pytest.raises(SystemExit, match="(?s)Z: .*boom"):
        peers.peer_row("Z", f"{sys.executable} -c \"raise ValueError('boom')\"", None)
