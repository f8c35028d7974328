"""The partitioned solution is the monolithic one in every shipped scene; restarts, the iterative
solver, the pressure's level.
"""

import numpy as np
import pytest
from mpi4py import MPI
from running import SCENES, Job, history, run_here, run_on, state, summary

from porofsi_petsc import list_scenes, load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.linalg.options import start
from porofsi_petsc.phases.residual import Residual
from porofsi_petsc.phases.skeleton import Skeleton
from porofsi_petsc.simulation import builder
from porofsi_petsc.simulation.loop import Clock
from porofsi_petsc.simulation.simulation import Simulation

TIGHT = ("coupling.tolerance=1e-11", "coupling.max_iterations=100", "coupling.accelerator=anderson")
# The solutions differ by the tolerance times the condition of a step: the bound leaves a factor of
# a hundred.
DIFFERENCE = 1e-9
STEPS = 2
PULSE = (
    "mesh.order=1",
    "mesh.x.cells=[4, 2, 4]",
    "mesh.y.cells=[4]",
    "time.end=0.003",
    "figures.times=[]",
)
P2 = (
    "mesh.order=2",
    "mesh.x.cells=[3, 2, 3]",
    "mesh.y.cells=[3]",
    "time.end=0.002",
    "figures.times=[]",
)
VARIABLE = (
    "model.porosity=variable",
    "material.0.permeability={law='markert', k=1e-3, exponent=2.0}",
)
VARIANTS = {
    "quadratic, another law": ("pulse2d", (*P2, "material.0.solid.law=neo_hookean_j2")),
    "variable porosity": ("pulse2d", (*PULSE, *VARIABLE)),
    "three-dimensional": (str(SCENES / "block3d.toml"), ("time.end=0.002",)),
}


def shortened(path):
    """Return the changes that leave a few steps of a shipped scene on its coarsest mesh."""
    scene = load_scene(path, smoke=True)
    coarse = [f"{key}={value}" for key, value in scene.smoke.items() if key.startswith("mesh.")]
    step = scene.time.step
    steps = STEPS if coarse else 1
    end = step * (1 + scene.time.growth) if scene.time.growth > 1 else steps * step
    return (*coarse, f"time.end={min(end, scene.time.end)}", "expect=[]", "figures.times=[]")


def is_strong(path):
    """Return whether a scene asks for the solution of all equations together, which the weak
    schemes do not have.
    """
    return load_scene(path).coupling.scheme not in ("weak", "one_way")


# A run halves its steps where they do not converge, which the loop below does not.
HALVED = {"rubber_sheet"}
# A scene at rest until it is loaded would compare round-off.
LOADED = {"surcharge": ("boundary.2.traction.y=-2e4",)}
CASES = {
    name: (str(path), (*shortened(path), *LOADED.get(name, ())))
    for name, _, path in list_scenes()
    if is_strong(path) and name not in HALVED
} | VARIANTS


def end_states(scene, overrides, **schemes):
    """Return scheme name -> the arrays of the phases after some steps of a scene on this rank
    alone.
    """
    start(load_scene(scene).petsc.options)
    states = {}
    for name, changes in schemes.items():
        loaded = load_scene(scene, (*overrides, *TIGHT, *changes))
        coupling = Simulation(loaded, MPI.COMM_SELF).coupling
        clock = Clock(loaded.time)
        while not clock.finished:
            size = clock.next_size()
            target = clock.next_target()
            coupling.step(*clock.schemes(loaded.model, size), clock.t, clock.step + 1)
            coupling.accept()
            clock.advance(size, target)
        fields = {
            "u": coupling.solid.u,
            "v_s": coupling.solid.v,
            "v_f": coupling.fluid.v,
            "p": coupling.fluid.p,
        }
        states[name] = {key: field.copy() for key, field in fields.items()}
        for block in coupling.blocks.values():
            if block.solver:
                block.solver.destroy()
    return states


def largest_differences(states):
    """Return field -> largest difference of the two states over the largest value."""
    a, b = states.values()
    return {name: np.abs(a[name] - b[name]).max() / (np.abs(b[name]).max() or 1.0) for name in a}


PAIR = {"partitioned": (), "direct": ("coupling.scheme=direct",)}


@pytest.mark.parametrize("case", CASES)
def test_partitioned_solution_is_the_direct_one(case):
    differences = largest_differences(end_states(*CASES[case], **PAIR))
    print(case, {name: f"{value:.1e}" for name, value in differences.items()})
    assert max(differences.values()) < DIFFERENCE, differences


def test_quasi_direct_solution_is_the_direct_one():
    pair = {"quasi_direct": ("coupling.scheme=quasi_direct",), "direct": PAIR["direct"]}
    assert (
        max(largest_differences(end_states(*VARIANTS["variable porosity"], **pair)).values())
        < DIFFERENCE
    )


def test_a_wrong_split_is_detected(monkeypatch):
    """A loop that ends on residuals of its own, here with one part in a thousand of the drag
    missing, is another solution.
    """
    residual = Skeleton.residual

    def wrong(self, flow):
        correct = residual(self, flow)
        if self.setup.split != "plain":
            return correct
        terms = correct.terms | {"drag": 0.999 * correct.terms["drag"]}
        return Residual(self.mesh.comm, terms, self.setup.dirichlet.free)

    monkeypatch.setattr(Skeleton, "residual", wrong)
    pair = {"wrong": ("coupling.split=plain",), "direct": PAIR["direct"]}
    differences = largest_differences(end_states("pulse2d", PULSE, **pair))
    assert min(differences[name] for name in ("u", "v_s", "p")) > 1000 * DIFFERENCE, differences
    monkeypatch.undo()
    assert max(largest_differences(end_states("pulse2d", PULSE, **pair)).values()) < DIFFERENCE


@pytest.mark.parametrize("scheme", ["quasi_direct", "direct"])
@pytest.mark.parametrize(
    "scene, overrides",
    [
        ("pulse2d", PULSE),
        ("column_harmonic", ("mesh.y.cells=[9, 4]",)),
        (
            "pulse3d",
            ("mesh.x.cells=[1, 3]", "mesh.y.cells=[1, 3]", "mesh.z.cells=[4]"),
        ),  # iterative
    ],
)
def test_a_restart_goes_on_identically(tmp_path, scene, overrides, scheme):
    common = (
        *overrides,
        f"coupling.scheme={scheme}",
        "time.step=1e-3",
        "output.checkpoint_every=2",
    )
    for name, end, restart in (
        ("whole", 0.004, None),
        ("first", 0.002, None),
        ("second", 0.004, "first"),
    ):
        restart = restart and str(tmp_path / restart / "checkpoint.h5")
        run_here(Job(scene, str(tmp_path / name), (*common, f"time.end={end}"), restart))
    whole, second = (state(tmp_path / name / "checkpoint.h5") for name in ("whole", "second"))
    assert whole.keys() == second.keys()
    for name in whole:
        assert np.array_equal(whole[name], second[name]), name


# -- the iterative solver --------------------------------------------------------------------------


def solver_iterations(monkeypatch, scene, *overrides):
    """Return the iterations of every solve of a step by FGMRES around a sweep over the phases,
    whose blocks are iterative too.
    """
    start()
    monkeypatch.setattr(builder, "is_direct", lambda mesh: False)
    loaded = load_scene(scene, (*overrides, "coupling.scheme=direct"))
    coupling = Simulation(loaded, MPI.COMM_SELF).coupling
    schemes, rates = Clock(loaded.time).next_schemes(loaded.model)
    coupling.step(schemes, rates, 0.0, 1)
    iterations = list(coupling.system.block.solver.iterations)
    for block in coupling.blocks.values():
        block.solver.destroy()
    return iterations


@pytest.mark.parametrize("k", ["1e-2", "1e-5", "1e-9"])
def test_iterations_are_bounded_under_refinement_at_every_permeability(monkeypatch, k):
    """Measured 5 to 11: the sweep alone contracts by 0.45 or better."""
    for n in (1, 2, 4):
        cells = (f"mesh.x.cells=[{4 * n}, {2 * n}, {4 * n}]", f"mesh.y.cells=[{4 * n}]")
        permeability = f"material.0.permeability.k={k}"
        assert (
            max(solver_iterations(monkeypatch, "pulse2d", "mesh.order=1", *cells, permeability))
            <= 13
        )
    assert max(solver_iterations(monkeypatch, "pulse2d", *P2, permeability)) <= 15


@pytest.mark.parametrize("order", [1, 2])
def test_iterations_in_three_dimensions(monkeypatch, order):
    assert (
        max(solver_iterations(monkeypatch, str(SCENES / "block3d.toml"), f"mesh.order={order}"))
        <= 13
    )


def test_two_ranks_solve_like_one(tmp_path):
    """The solver's tolerance times Newton's last step, against the strain of the first steps."""
    overrides = ("coupling.scheme=direct", "coupling.tolerance=1e-10", "time.end=0.002")
    jobs = {
        ranks: Job(str(SCENES / "block3d.toml"), str(tmp_path / str(ranks)), overrides)
        for ranks in (1, 2)
    }
    run_here(jobs[1])
    run_on(2, [jobs[2]], tmp_path)
    one, two = (history(job.directory) for job in jobs.values())
    for column in set(one) - {"t"}:
        assert np.abs(one[column] - two[column]).max() <= 1e-8 * np.abs(one[column]).max(), column
    assert summary(jobs[2].directory)["linear_iterations"]["monolithic"]["max"] <= 13


# -- the level of the pressure ---------------------------------------------------------------------

RIGID = (
    "boundary.2={ on = ['top', 'strip'], displacement = { y = 0.0 } }",
    "boundary.3={ on = 'strip' }",
    "body_force={ solid = { y = '-y' } }",
)


@pytest.mark.parametrize("scheme", ["partitioned", "direct"])
def test_a_rigid_closed_box_is_refused(tmp_path, scheme):
    """Any constant may be added to the pressure: what came out depended on the solver."""
    with pytest.raises(InputError, match="the pressure has no level"):
        run_here(Job("pulse2d", str(tmp_path), (*PULSE, *RIGID, f"coupling.scheme={scheme}")))


def test_a_closed_box_under_a_load_has_the_level_of_the_load():
    """Undrained and confined: nothing can move, and the pressure takes the whole load at once."""
    sides = (
        "{ on = ['left', 'right'], displacement = { x = 0.0 } }, { on = 'bottom', displacement = {"
        " y = 0.0 } }"
    )
    closed = f"boundary=[{sides}, {{ on = ['top', 'strip'], traction = {{ y = -1e5 }} }}]"
    at_once = (  # else the pressure at the end of a step takes some steps to follow a jump
        "time.rho_inf=0.0"
    )
    for state_of_scheme in end_states("pulse2d", (*PULSE, closed, at_once), **PAIR).values():
        assert (
            np.abs(state_of_scheme["p"] - 1e5).max() < 1e-6 * 1e5
        )  # the tolerance 1e-11 of the forces times a condition of 1e4
        assert np.abs(state_of_scheme["u"]).max() < 1e-9  # against 5 mm of the drained block
