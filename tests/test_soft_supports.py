"""Springs, dashpots and absorbing boundaries, against exact solutions."""

import numpy as np
import pytest
from running import SCENES, Job, history, needs_mpirun, run_here, run_on

from porofsi_petsc.errors import InputError

BAR = str(SCENES / "bar.toml")
YOUNG = 1000.0


def run(folder, *overrides):
    """Return the history of the bar with changes."""
    run_here(Job(BAR, str(folder), overrides))
    return history(folder)


# -- springs ---------------------------------------------------------------------------------------

LENGTH, DEPTH = 6.0, 0.08
BEAM = (
    "model.solid_inertia=false",
    "time.scheme=steady",
    "time.step=1.0",
    "mesh.cell_type=quadrilateral",
    "mesh.diagonal=right",
    f"mesh.x={{points=[0.0, {LENGTH}], cells=[60]}}",
    f"mesh.y={{points=[0.0, {DEPTH}], cells=[1]}}",
    f"material.0.solid={{law='linear_elastic', young={YOUNG}, poisson=0.0, density=1.0}}",
)


def beam(*sides):
    """Return the changes that make of the bar a beam with these sides."""
    return (*BEAM, f"boundary=[{', '.join(sides)}]")


def probe(x, *quantities):
    """Return the change that sets a probe on the axis."""
    return f"probe=[{{name='A', at=[{x}, {DEPTH / 2}], quantities={list(quantities)}}}]"


def test_long_beam_on_winklers_foundation(tmp_path):
    """An end force P sinks in by 2 P λ/k, λ⁴ = k/(4 EI); normal springs hold all but the way along
    the beam (Hetényi 1946).
    """
    stiffness = YOUNG * DEPTH**3 / 12
    k = 4 * stiffness  # λ = 1/m
    P = 1e-5 * stiffness
    sides = (
        f"{{on='bottom', spring={{normal={k}}}}}",
        f"{{on='left', traction={{y={-P / DEPTH}}}}}",
        "{on='right', displacement={x=0.0}}",
        "{on='top'}",
    )
    found = run(tmp_path, *beam(*sides), probe(0.0, "u_y"))["A.u_y"][-1]
    # shear adds (λh)²/5, and the springs are at the lower side
    assert found == pytest.approx(-2 * P / k, rel=3e-3)


def test_rod_in_tangential_springs(tmp_path):
    """E h u'' = k u: at the pulled end u = F coth(κL)/(E h κ), κ² = k/(E h)."""
    k = YOUNG * DEPTH / LENGTH**2
    kappa = 1 / LENGTH
    sides = (
        f"{{on='bottom', spring={{tangential={k}}}}}",
        "{on='right', traction={x=1e-3}}",
        "{on=['left', 'top']}",
    )
    message = r"nothing holds the solid in y"
    with pytest.raises(InputError, match=message):
        run(tmp_path / "loose", *beam(*sides))
    held = (*sides[:1], "{on='right', traction={x=1e-3}}", "{on='left'}")
    held += ("{on='top', displacement={y=0.0}}",)
    found = run(tmp_path / "held", *beam(*held), probe(LENGTH, "u_x"))["A.u_x"][-1]
    exact = 1e-3 / (YOUNG * kappa) / np.tanh(kappa * LENGTH)
    assert found == pytest.approx(exact, rel=1e-3)  # the shear of the rod: (h/L)²


def test_damped_oscillator(tmp_path):
    """A block on a spring and a dashpot under a load that is switched on."""
    mass, omega, damping = 2.0, 5.0, 0.2  # per area [kg/m²], [1/s], [-]
    k, c, p = mass * omega**2, 2 * mass * omega * damping, 0.01
    sides = (
        f"boundary=[{{on='bottom', spring={{normal={k}}}, dashpot={{normal={c}}}}},"
        f" {{on=['left', 'right'], displacement={{x=0.0}}}}, {{on='top', traction={{y={-p}}}}}]"
    )
    # a block so stiff that it is one mass: its own period is 1/200 of that of the spring
    stiff = "material.0.solid={law='linear_elastic', young=1e6, poisson=0.0, density=2.0}"
    found = run(tmp_path, sides, stiff, "time.step=0.01", "time.rho_inf=0.8")
    t = found["t"]
    turning = omega * np.sqrt(1 - damping**2)
    decay = np.exp(-damping * omega * t)
    swing = np.cos(turning * t) + damping * omega / turning * np.sin(turning * t)
    exact = -p / k * (1 - decay * swing)
    assert np.abs(found["A.u_y"] - exact).max() < 5e-3 * np.abs(exact).max()


# -- absorbing boundaries --------------------------------------------------------------------------

DENSITY, MU, LAME = 2.0, 5.0, 6.0  # of the bar
RICKER = "(1 - 2*(pi*(t - 0.6)/0.5)**2)*exp(-(pi*(t - 0.6)/0.5)**2)"


def ricker(t):
    """Return the wavelet of RICKER."""
    a = (np.pi * (t - 0.6) / 0.5) ** 2
    return (1 - 2 * a) * np.exp(-a)


WAVES = {
    "P": ("y", "x", np.sqrt((LAME + 2 * MU) / DENSITY)),
    "S": ("x", "y", np.sqrt(MU / DENSITY)),
}
FINE = ("mesh.y.cells=[8]", "time.step=0.01", "time.rho_inf=0.9", "time.end=2.6")


@pytest.mark.parametrize("wave", WAVES)
def test_a_pulse_leaves(tmp_path, wave):
    """The top of a half-space under a traction σ moves with v = σ/(ρ c); nothing comes back after
    2 L/c.
    """
    along, across, c = WAVES[wave]
    sides = (
        f"boundary=[{{on='bottom', absorbing={{}}}}, {{on='top', traction={{{along}='{RICKER}'}}}},"
        f" {{on=['left', 'right'], displacement={{{across}=0.0}}}}]"
    )
    record = f"probe=[{{name='A', at=[0.125, 1.0], quantities=['v_{along}']}}]"
    found = run(tmp_path, sides, record, *FINE)
    exact = ricker(found["t"]) / (DENSITY * c)
    error = np.abs(found[f"A.v_{along}"] - exact).max() / np.abs(exact).max()
    print(f"{wave}: largest error {error:.2%} of the pulse")
    assert found["t"][-1] > 1.2 + 2 / c  # the echo would be there
    assert error < 0.02


@pytest.mark.parametrize("wave", WAVES)
def test_a_wave_comes_in_through_a_compliant_base(tmp_path, wave):
    """The free surface moves with 2 v_in(t - L/c), and what it sends back leaves."""
    along, across, c = WAVES[wave]
    sides = (
        f"boundary=[{{on='bottom', absorbing={{incident={{{along}='{RICKER}'}}}}}}, {{on='top'}},"
        f" {{on=['left', 'right'], displacement={{{across}=0.0}}}}]"
    )
    record = f"probe=[{{name='A', at=[0.125, 1.0], quantities=['v_{along}']}}]"
    found = run(tmp_path, sides, record, *FINE)
    t = found["t"]
    exact = 2 * ricker(t - 1 / c)
    error = np.abs(found[f"A.v_{along}"] - exact).max() / 2
    print(f"{wave}: largest error {error:.2%} of the wave")
    assert error < 0.03  # the time scheme's error of the speed, (ω Δt)²/12, over ω L/c


def test_it_stands_alone(tmp_path):
    with pytest.raises(InputError, match="which excludes"):
        run(tmp_path, "boundary.0={on='bottom', absorbing={}, spring={normal=1.0}}")


# -- saturated columns -----------------------------------------------------------------------------

N_S, RHO_S, RHO_F = 0.6, 2.5, 1.0  # solid fraction, true densities
POROUS = (
    "model.solid_inertia=true",
    "model.fluid_inertia=true",
    "time.consistent_start=false",
    "coupling.tolerance=1e-7",
)
# Darcy coefficients of a soil so permeable that the fluid hardly feels it, and of one that takes
# all of it along [m/s]
FREE, STUCK = 1e3, 1e-5


def soil(permeability):
    """Return the change that sets a saturated material with the moduli of the bar."""
    solid = f"solid={{law='linear_elastic', lambda={LAME}, mu={MU}, density={RHO_S}}}"
    fluid = f"fluid={{density={RHO_F}, specific_weight=10.0}}"
    return (
        f"material=[{{region='body', porosity={1 - N_S}, {solid}, {fluid},"
        f" permeability={{law='constant', k={permeability}}}}}]"
    )


def masses(wave):
    """Return the mass that a wave moves [kg/m³]: P against the fluid, S with it."""
    n_f = 1 - N_S
    if wave == "P":
        return N_S * RHO_S + (N_S / n_f) ** 2 * n_f * RHO_F
    return N_S * RHO_S + n_f * RHO_F


COARSE = (*FINE, "time.step=0.014", "time.end=2.5")


@pytest.mark.parametrize(
    ("wave", "permeability", "scheme"), [("P", FREE, "partitioned"), ("S", STUCK, "direct")]
)
def test_a_pulse_leaves_a_saturated_column(tmp_path, wave, permeability, scheme):
    """The drained top moves with σ/√(ρ M), the mass that of de Boer, Ehlers & Liu (1993) for P, of
    the mixture for S; nothing comes back.
    """
    along, across, _ = WAVES[wave]
    modulus = LAME + 2 * MU if wave == "P" else MU
    rho = masses(wave)
    c = np.sqrt(modulus / rho)
    sides = (
        "boundary=[{on='bottom', absorbing={}},"
        f" {{on='top', traction={{{along}='1e-3*{RICKER}'}}, pressure=0.0}},"
        f" {{on=['left', 'right'], displacement={{{across}=0.0}}, velocity={{x=0.0}}}}]"
    )
    if wave == "S":
        sides = sides.replace(", velocity={x=0.0}", "")
    record = f"probe=[{{name='A', at=[0.125, 1.0], quantities=['v_{along}']}}]"
    found = run(
        tmp_path, sides, record, soil(permeability), f"coupling.scheme={scheme}", *POROUS, *COARSE
    )
    exact = 1e-3 * ricker(found["t"]) / (rho * c)
    error = np.abs(found[f"A.v_{along}"] - exact).max() / np.abs(exact).max()
    sweeps = found["coupling_iterations"].max()
    print(f"{wave}: largest error {error:.2%} of the pulse, {sweeps:.0f} sweeps at most")
    assert found["t"][-1] > 1.2 + 2 / c
    assert error < 0.05


def test_an_undrained_pulse_leaves_a_compressible_column(tmp_path):
    """With a compressible pore fluid the impermeable top moves with σ/(ρ c_u), ρ of the mixture and
    ρ c_u² = λ + 2μ + K_f/n_f (Biot 1956, no drainage).
    """
    n_f, K_f = 1 - N_S, 20.0
    rho = N_S * RHO_S + n_f * RHO_F
    c = np.sqrt((LAME + 2 * MU + K_f / n_f) / rho)
    sides = (
        "boundary=[{on='bottom', absorbing={}},"
        f" {{on='top', traction={{y='1e-3*{RICKER}'}}}},"
        " {on=['left', 'right'], displacement={x=0.0}, velocity={x=0.0}}]"
    )
    compressible = soil(STUCK).replace("specific_weight", f"bulk_modulus={K_f}, specific_weight")
    record = "probe=[{name='A', at=[0.125, 1.0], quantities=['v_y', 'p']}]"
    found = run(tmp_path, sides, record, compressible, *POROUS, *COARSE)
    exact = 1e-3 * ricker(found["t"]) / (rho * c)
    error = np.abs(found["A.v_y"] - exact).max() / np.abs(exact).max()
    print(f"largest error {error:.2%} of the pulse")
    assert error < 0.05


COLUMN = (
    "boundary=[{on='bottom', absorbing={}},"
    f" {{on='top', traction={{y='1e-3*{RICKER}'}}, pressure=0.0}},"
    " {on=['left', 'right'], displacement={x=0.0}}]",
    soil(FREE),
    *POROUS,
    *COARSE,
    "coupling.scheme=direct",
    "time.step=0.015625",
    "time.end=1.25",
    "probe=[{name='A', at=[0.125, 1.0], quantities=['v_y']},"
    " {name='B', at=[0.125, 0.0], quantities=['v_y', 'p', 'vf_y']}]",
    "force=[{name='base', on='bottom'}]",
)


def test_force_and_flow_on_the_surface_of_a_saturated_column(tmp_path):
    """The mixture pushes with Z v - p, and the total flux is zero."""
    found = run(tmp_path, *COLUMN)
    v, p = found["B.v_y"], found["B.p"]
    force = 0.25 * (np.sqrt(16 * masses("P")) * v - p)
    size = np.abs(force).max()
    assert np.abs(found["base.f_y"] - force).max() < 0.03 * size  # at nodes, not over the surface
    flux = N_S * v + (1 - N_S) * found["B.vf_y"]
    assert np.abs(flux).max() < 0.02 * np.abs(v).max()


@needs_mpirun
def test_restart_and_ranks_give_the_same(tmp_path):
    short = (*COLUMN, "time.end=0.75")
    half = (*COLUMN, "time.end=0.5", "output.checkpoint_every=32")
    run_here(Job(BAR, str(tmp_path / "half"), half))
    restart = str(tmp_path / "half/checkpoint.h5")
    run_here(Job(BAR, str(tmp_path / "rest"), short, restart=restart))
    run_here(Job(BAR, str(tmp_path / "whole"), short))
    run_on(2, [Job(BAR, str(tmp_path / "two"), short)], tmp_path)
    whole, rest, two = (history(tmp_path / name) for name in ("whole", "rest", "two"))
    for name in ("A.v_y", "B.v_y", "B.p"):
        assert rest[name][-1] == whole[name][-1]
        assert np.abs(two[name] - whole[name]).max() < 1e-6 * np.abs(whole[name]).max()
