"""Body forces of regions and over time, against exact solutions."""

import numpy as np
import pytest
from running import SCENES, Job, history, run_here

from porofsi_petsc.errors import InputError

BAR = str(SCENES / "bar.toml")
LAME, MU, DENSITY, LENGTH = 6.0, 5.0, 2.0, 1.0  # of the bar
STATIC = ("model.solid_inertia=false", "time.scheme=steady", "time.step=1.0")
REGIONS = (
    "mesh.regions=[{name='upper', y=[0.5, 1.0]}]",
    "material.0.region='all'",
)


def test_weight_of_one_region(tmp_path):
    """A bar of which the upper half alone is heavy: u(L) = -ρ b (H/2) (L - H/4)/E_c."""
    force = "body_force=[{on='upper', solid={y=-1e-3}}]"
    run_here(Job(BAR, str(tmp_path), (*STATIC, *REGIONS, force)))
    found = history(tmp_path)["A.u_y"][-1]
    exact = -DENSITY * 1e-3 * 0.5 * (LENGTH - 0.25) / (LAME + 2 * MU)
    assert found == pytest.approx(exact, rel=1e-9)


def test_several_add_up(tmp_path):
    """Two halves have what the whole has; entries on the same region add up."""
    whole = "body_force.solid.y=-3e-3"
    parts = (
        "body_force=[{on=['body', 'upper'], solid={y=-1e-3}}, {on='all', solid={y=-1e-3}},"
        " {on='upper', solid={y=-1e-3}}, {on='body', solid={y=-1e-3}}]"
    )
    found = []
    for name, force in (("whole", whole), ("parts", parts)):
        run_here(Job(BAR, str(tmp_path / name), (*STATIC, *REGIONS, force)))
        found.append(history(tmp_path / name)["A.u_y"][-1])
    assert found[1] == pytest.approx(found[0], rel=1e-12)


def test_an_unknown_region_is_refused(tmp_path):
    force = "body_force=[{on='lower', solid={y=-1e-3}}]"
    with pytest.raises(InputError, match=r"body_force.0.on\].*'lower'"):
        run_here(Job(BAR, str(tmp_path), (*STATIC, *REGIONS, force)))
    with pytest.raises(InputError, match=r"body_force.0.solid.z\]: received a component"):
        run_here(Job(BAR, str(tmp_path), ("body_force=[{on='all', solid={z=-1e-3}}]",)))


def answer(omega, times, values, t):
    """Return q(t) of q'' + ω² q = -a(t), a linear between the rows: exact from row to row."""
    found = np.zeros(len(t))
    slopes = np.diff(values) / np.diff(times)
    kinks = np.diff(np.concatenate([[0.0], slopes, [0.0]]))
    for start, change in zip(times, kinks, strict=True):
        s = np.maximum(t - start, 0.0)
        found -= change * (s - np.sin(omega * s) / omega) / omega**2
    return found


def shear_beam(times, values, t, height, speed, modes=60):
    """Return the displacement of the top of a shear beam relative to its base, which has the
    acceleration a(t), a(0) = 0: Σ φ_n(H) Γ_n q_n.
    """
    total = np.zeros(len(t))
    for n in range(modes):
        k = (n + 0.5) * np.pi / height
        total += 2 / (k * height) * np.sin(k * height) * answer(k * speed, times, values, t)
    return total


def test_base_acceleration_of_a_table(tmp_path):
    """In the frame of its base a column feels -a(t) on its mass (shear beam, modal sum)."""
    times = np.array([0.0, 0.3, 0.5, 0.9, 1.2])
    values = np.array([0.0, 0.02, -0.03, 0.01, 0.0])
    path = tmp_path / "base.csv"
    rows = zip(times, values, strict=True)
    path.write_text("t,a\n" + "".join(f"{t},{a}\n" for t, a in rows))
    sides = (
        "boundary=[{on='bottom', displacement={x=0.0, y=0.0}}, {on='top'},"
        " {on=['left', 'right'], displacement={y=0.0}}]"
    )
    force = f"body_force.solid.x={{table='{path}', column='a', factor=-1.0}}"
    record = "probe=[{name='A', at=[0.125, 1.0], quantities=['u_x']}]"
    fine = ("mesh.y.cells=[8]", "time.step=0.01", "time.end=2.0", "time.rho_inf=0.9")
    run_here(Job(BAR, str(tmp_path / "run"), (sides, force, record, *fine)))
    found = history(tmp_path / "run")
    exact = shear_beam(times, values, found["t"], LENGTH, np.sqrt(MU / DENSITY))
    error = np.abs(found["A.u_x"] - exact).max() / np.abs(exact).max()
    print(f"largest error {error:.2%}")
    assert error < 3e-3  # 0.6 % with steps of 0.02 s, 0.16 % with these
