"""A porous solid with variable coefficients beside a free fluid: tangents, exact states of columns,
orders, refusals.
"""

import re

import numpy as np
import pytest
from mpi4py import MPI
from plug import LENGTH, MODULUS, MU, K, U, compressed, moved_in_time, plug
from running import SCENES, Job, history, needs_mpirun, run_here, run_on
from small_media import FD_STEP, FD_TOLERANCE, dense

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.config import scene_to_toml
from porofsi_petsc.errors import ConvergenceError, InputError, LimitError
from porofsi_petsc.simulation.loop import Clock

pytestmark = pytest.mark.usefixtures("petsc")

KOZENY_CARMAN = {"law": "kozeny_carman", "intrinsic": 1e-3}
HOLMES_MOW = {"law": "holmes_mow", "intrinsic": 1e-3, "exponent": 2.0, "slope": 4.6}
AXES = {"anisotropy": [1.0, 0.2], "angle": 30.0}
DYNAMIC = {
    "model": {"solid_inertia": True, "fluid_inertia": True, "convection": True},
    "time": {"scheme": "generalized_alpha", "end": 1.0, "step": 0.005},
}


def in_motion(scene):
    """Return the coupling of a scene within a step from a random accepted state to a random trial
    state, and the rates.
    """
    rng = np.random.default_rng(3)
    loaded = load_scene(scene)
    coupling = Simulation(loaded, MPI.COMM_SELF).coupling
    schemes, rates = Clock(loaded.time).next_schemes(loaded.model)
    u, v, v_f = (scale * rng.standard_normal(coupling.solid.u.shape) for scale in (2e-3, 0.1, 0.3))
    coupling.solid.set_initial(u, v)
    coupling.motion.set_initial(u, v)
    coupling.fluid.set_initial(v_f, 1e4 * rng.standard_normal(len(u)))
    coupling.begin_phases(schemes, rates, 0.0)
    add(coupling, rng.standard_normal((len(u), 5)) * SCALES)
    return coupling, rates


SCALES = np.array([0.002, 0.002, 0.3, 0.3, 1e4])  # of u [m], v [m/s] and p [Pa]


def add(coupling, increment):
    """Add an increment of u, v_f and p on the collocation level to the trial state; the mesh
    follows.
    """
    coupling.solid.add(increment[:, :2])
    coupling.motion.follow(coupling.solid.end_displacement)
    coupling.fluid.add(increment[:, 2:])


def residuals(coupling):
    """Return the `Residual`s of the solid, the fluid's momentum and volume."""
    of_fluid = coupling.fluid.residual(coupling.mesh_state())
    return coupling.solid.residual(coupling.flow(of_fluid)), *of_fluid


def difference(coupling, unknowns):
    """Return the derivative of the residuals by the unknowns, pairs of node and component, dense;
    that by the solid's positions has that by the mesh's, which follow.
    """
    columns = []
    for node, component in unknowns:
        increment = np.zeros((coupling.solid.mesh.n_local, 5))
        increment[node, component] = FD_STEP * SCALES[component]
        values = []
        for step in (increment, -2 * increment):
            add(coupling, step)
            values.append(np.column_stack([part.total for part in residuals(coupling)]).ravel())
        add(coupling, increment)
        columns.append((values[0] - values[1]) / (2 * FD_STEP * SCALES[component]))
    return np.column_stack(columns)


def condensed(matrix, kept, mesh):
    """Return the rows and columns `kept` of a matrix, from which those of the mesh, which follows,
    are eliminated.
    """
    follows = np.linalg.solve(matrix[np.ix_(mesh, mesh)], matrix[np.ix_(mesh, kept)])
    return matrix[np.ix_(kept, kept)] - matrix[np.ix_(kept, mesh)] @ follows


RING = {  # the left side is the axis, the plug above
    "mesh": {
        "x": {"points": [0.0, 0.5], "cells": [2]},
        "y": {"points": [0.0, 1.0, 2.0], "cells": [1, 1]},
        "regions": [{"name": "plug", "y": [1.0, 2.0]}],
        "axisymmetric": True,
    },
    "boundary": [
        {"on": "bottom", "velocity": {"x": 0.0, "y": 0.3}},
        {"on": "right", "velocity": {"x": 0.0}, "displacement": {"x": 0.0}},
        {"on": "top", "displacement": {"y": 0.0}},
    ],
    "probe": [],
}
PLANE = {
    "mesh": {
        "x": {"points": [0.0, 1.0, 2.0], "cells": [1, 1]},
        "y": {"points": [0.0, 0.5], "cells": [2]},
    }
}


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    "permeability, shape",
    [(KOZENY_CARMAN, PLANE), (HOLMES_MOW | AXES, PLANE), (HOLMES_MOW, RING)],
    ids=["kozeny_carman", "holmes_mow with axes", "rings"],
)
def test_direct_tangent_is_the_derivative_of_all_residuals(permeability, shape, order):
    """By the positions, which the mesh of the fluid follows, velocity and pressure."""
    changes = DYNAMIC | shape | {"mesh_motion": {"law": "linear_elastic"}}
    changes |= {"body_force": {"solid": {"y": -10.0}, "fluid": {"x": 5.0, "y": -10.0}}}
    scene = plug(order=order, law="neo_hookean", permeability=permeability, **changes)
    coupling, rates = in_motion(scene)
    system = coupling.system
    free = ~system.block.mask
    of_mesh = free & (np.arange(5) < 2) & ~coupling.solid.domain.holds[:, None]
    kept, mesh = (np.flatnonzero(rows) for rows in (free & ~of_mesh, of_mesh))
    expected = difference(coupling, np.argwhere(free & ~of_mesh))[kept]
    solid, *of_fluid = residuals(coupling)
    system.correct(solid, of_fluid, rates)  # makes the matrix of this state
    matrix = condensed(dense(system.block.matrix.mat), kept, mesh)
    fields = [kept % 5 < 2, (kept % 5 >= 2) & (kept % 5 < 4), kept % 5 == 4]
    for i, j in np.ndindex(3, 3):
        block = np.ix_(fields[i], fields[j])
        error = np.abs(matrix[block] - expected[block]).max()
        assert error <= FD_TOLERANCE * np.abs(expected[block]).max(), (i, j, error)


def final(scene):
    """Return the last row of the history of a scene."""
    with Simulation.from_scene(scene) as simulation:
        simulation.run()
        return {name: values[-1] for name, values in simulation.history.items()}


RIGID = {"model": {"moving_mesh": False, "porosity": "constant"}, "law": "linear_elastic"}


def test_layers_in_series_add_their_resistances():
    """Darcy's drop is μ U Σ L_i/K_i, to round-off where the layers end on sides of cells."""
    layers = {"law": "constant", "intrinsic": "where(x < 1.5, 1e-6, 4e-6)"}
    found = final(plug(permeability=layers, **RIGID))
    assert found["inlet.p"] == pytest.approx(MU * U * (0.5 / 1e-6 + 0.5 / 4e-6), rel=1e-8)
    assert found["middle.p"] == pytest.approx(MU * U * 0.5 / 4e-6, rel=1e-8)


def test_a_graded_permeability_has_its_integral_with_second_order():
    """K0 x: μ U ln 2/K0, by the rule of the midpoint; porosity and moduli may be fields too."""
    graded = {"law": "constant", "intrinsic": "1e-6*x"}
    fields = {
        "porosity": "0.4 + 0.1*(x - 1)",
        "solid": {"law": "linear_elastic", "young": "2e6*x", "poisson": 0.0, "density": 2000.0},
    }
    exact = MU * U * np.log(2) / 1e-6
    errors = [
        abs(final(plug(n, permeability=graded, porous=fields, **RIGID))["inlet.p"] / exact - 1)
        for n in (4, 8, 16)
    ]
    assert errors[-1] < 3e-4
    assert np.log2(errors[0] / errors[1]) > 1.9
    assert np.log2(errors[1] / errors[2]) > 1.9


XIE_LEO = {"law": "xie_leo", "intrinsic": K}
SLOPE = MU * U / (MODULUS * K)  # J = 1 - SLOPE X of the steady plug [1/m]


@pytest.mark.parametrize("order, least, error", [(1, 1.9, 4e-4), (2, 1.9, 5e-6)])
def test_a_plug_whose_permeability_falls_as_it_is_compressed(order, least, error):
    """With P = E_c ln J and K = K0 J²: J = 1 - a X, a = μ U/(E_c K0), 0.7 at the end; p falls by
    -E_c ln J(L).
    """
    exact = {"face.u_x": SLOPE * LENGTH**2 / 2, "middle.u_x": SLOPE * 0.75 * LENGTH**2 / 2}
    exact |= {"inlet.p": -MODULUS * np.log(1 - SLOPE * LENGTH)}
    errors = []
    for cells in (8, 16):
        found = final(plug(cells, order, permeability=XIE_LEO))
        errors.append(max(abs(found[name] / value - 1) for name, value in exact.items()))
    print(order, errors)
    assert errors[1] < error
    assert order == 2 or np.log2(errors[0] / errors[1]) > least


def holmes_mow(J):
    return ((J - 0.6) / 0.4) ** 0.5 * np.exp(2.0 * (J**2 - 1) / 2)


def kozeny_carman(J):
    n = 1 - 0.6 / J
    return (n / 0.4) ** 3 * (0.6 / (1 - n)) ** 2


LAWS = {
    "holmes_mow": (holmes_mow, {"exponent": 0.5, "slope": 2.0}),
    "kozeny_carman": (kozeny_carman, {}),
}


@pytest.mark.parametrize("law", LAWS)
def test_plugs_of_other_laws_obey_their_differential_equation(law):
    """Neo-Hookean, P = μ (J - 1/J) + λ ln J/J; on 16 quadratic elements to 1e-4 of it."""
    factor, parameters = LAWS[law]
    permeability = {"law": law, "intrinsic": 3 * K} | parameters

    def stress(J):
        return 0.5e6 * (J - 1 / J) + 1e6 * np.log(J) / J

    X, J, u, p = compressed(stress, lambda J: 3 * factor(J))
    found = final(plug(16, law="neo_hookean", permeability=permeability))
    print(law, J[-1], found["face.u_x"] / u[0] - 1, found["inlet.p"] / p[0] - 1)
    assert J[-1] < 0.9
    assert found["face.u_x"] == pytest.approx(u[0], rel=1e-4)
    assert found["inlet.p"] == pytest.approx(p[0], rel=1e-4)
    assert found["middle.u_x"] == pytest.approx(np.interp(0.5, X, u), rel=1e-4)
    assert found["middle.p"] == pytest.approx(np.interp(0.5, X, p), rel=1e-4)


GROWTH = 1.0  # of the inflow [m/s²]
GROWING = {
    "time": {"scheme": "generalized_alpha", "end": 0.4, "step": 0.02, "rho_inf": 0.0},
    "permeability": XIE_LEO,
    "speed": f"{GROWTH}*t",
}


def test_a_plug_is_compressed_in_time_as_a_linear_equation_says():
    """Second order in time, from rest to J = 0.74 at the end of the plug."""
    exact = [moved_in_time(X, 0.4, K * MODULUS / MU, GROWTH) for X in (0.0, 0.5)]
    errors = []
    for step in (0.04, 0.02):
        found = final(plug(8, **GROWING | {"time": GROWING["time"] | {"step": step}}))
        values = [found["face.u_x"], found["middle.u_x"]]
        errors.append(np.abs(np.array(values) / exact - 1).max())
    print(errors, found)
    assert errors[1] < 1e-3
    assert np.log2(errors[0] / errors[1]) > 1.8


@pytest.mark.parametrize("pair", ["condensed", "robin_robin", "dirichlet_neumann"])
def test_a_solid_without_pores_may_have_fields_beside_a_free_fluid(pair):
    """A field of equal values is the number, to the tolerance of the sweeps."""
    scene = str(SCENES / "flap.toml")
    changes = "time.end=0.03", f"coupling.interface={pair}", "coupling.tolerance=1e-10", "force=[]"
    tips = []
    for young in (5e5, "5e5 + 0*x"):
        given = "material.1.solid={law='linear_elastic', poisson=0.3, density=1000.0, "
        given += f"young={young!r}}}"
        tips.append(final(load_scene(scene, (*changes, given, "limits.strain=report")))["tip.u_x"])
    assert tips[1] == pytest.approx(tips[0], rel=1e-8)


GRAVITY = 10.0  # [m/s²]


@pytest.mark.parametrize("scheme", ["direct", "partitioned"])
@pytest.mark.parametrize("porosity", ["constant", "variable"])
def test_a_bed_under_water_at_rest_bears_its_buoyant_weight(scheme, porosity):
    """p grows by ρ_fR g per depth in the pores as above them, nothing flows, and the bed settles by
    n_s (ρ_sR - ρ_fR) g L²/(2 E_c), exact on quadratic elements but for its strain of 1.5e-3.
    """
    scene = plug(
        mesh={
            "x": {"points": [0.0, 0.5], "cells": [1]},
            "y": {"points": [0.0, 1.0, 2.0], "cells": [3, 3]},
            "regions": [{"name": "plug", "y": [0.0, 1.0]}],
            "patches": [
                {"name": f"bed_{side}", "side": side, "y": [0.0, 1.0]} for side in ("left", "right")
            ],
        },
        boundary=[
            {"on": ["left", "right"], "velocity": {"x": 0.0}},
            {"on": ["bed_left", "bed_right"], "velocity": {"x": 0.0}, "displacement": {"x": 0.0}},
            {"on": "bottom", "velocity": {"y": 0.0}, "displacement": {"y": 0.0}},
            {"on": "top"},
        ],
        body_force={phase: {"y": -GRAVITY} for phase in ("solid", "fluid")},
        probe=[
            {"name": "bottom", "at": [0.25, 0.0], "quantities": ["p"]},
            {"name": "face", "at": [0.25, 1.0], "quantities": ["p", "u_y", "vf_y"]},
        ],
        model={"porosity": porosity},
        law="linear_elastic",
        coupling={"scheme": scheme},
    )
    found = final(scene)
    print(found)
    settled = 0.6 * (2000.0 - 1000.0) * GRAVITY * LENGTH**2 / (2 * MODULUS)
    assert found["bottom.p"] == pytest.approx(1000.0 * GRAVITY * 2.0, rel=1e-6)
    assert found["face.p"] == pytest.approx(1000.0 * GRAVITY * (1.0 + settled), rel=1e-6)
    assert found["face.u_y"] == pytest.approx(-settled, rel=1e-6)
    assert abs(found["face.vf_y"]) < 1e-9


BED = 0.5  # height of the bed below the free fluid [m]


def manufactured(cells, order):
    """Return a flow v = curl ψ, ψ = sin(π x) sin(π y)/π, p = x y, over and in a rigid bed with K =
    0.01 (1 + x + y) m².
    """
    v = {"x": "sin(pi*x)*cos(pi*y)", "y": "-cos(pi*x)*sin(pi*y)"}
    force = {"x": f"({2 * MU}*pi**2*{v['x']} + y)", "y": f"({2 * MU}*pi**2*({v['y']}) + x)"}
    drag = {i: f"{MU}/(0.01*(1 + x + y))*({v[i]})" for i in "xy"}
    in_bed = {i: f"{force[i]} + {drag[i]}" for i in "xy"}
    line = {"points": [0.0, 1.0], "cells": [cells]}
    fixed = {"displacement": {"x": 0.0, "y": 0.0}, "velocity": v}
    scene = plug(
        order=order,
        permeability={"law": "constant", "intrinsic": "0.01*(1 + x + y)"},
        mesh={
            "x": line,
            "y": {"points": [0.0, BED, 1.0], "cells": [cells // 2] * 2},
            "regions": [{"name": "plug", "y": [0.0, BED]}],
            "patches": [
                {"name": f"bed_{side}", "side": side, "y": [0.0, BED]} for side in ("left", "right")
            ],
        },
        boundary=[
            {"on": ["left", "right", "top"], "velocity": v},
            {"on": ["bottom", "bed_left", "bed_right"]} | fixed,
        ],
        body_force=[{"on": "body", "fluid": force}, {"on": "plug", "fluid": in_bed}],
        probe=[
            {"name": f"at_{i}_{j}", "at": [x, y], "quantities": ["vf_x", "vf_y"]}
            for i, x in enumerate((0.21, 0.52, 0.83))
            for j, y in enumerate((0.17, 0.43, 0.5, 0.71))
        ],
        porous={"solid": {"law": "linear_elastic", "lambda": 1e9, "mu": 5e8, "density": 2000.0}},
        **RIGID,
    )
    for material in scene["material"]:
        material["fluid"]["density"] = 1.0
    return scene


def velocity_error(cells, order):
    """Return the root of the mean square error of the velocity at the probes [m/s]."""
    scene = manufactured(cells, order)
    found = final(scene)
    errors = []
    for probe in scene["probe"]:
        x, y = np.pi * np.array(probe["at"])
        exact = np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y)
        errors += [found[f"{probe['name']}.vf_{i}"] - v for i, v in zip("xy", exact, strict=True)]
    return np.sqrt(np.mean(np.square(errors)))


@pytest.mark.parametrize("order, least", [(1, 1.8), (2, 1.9)])
def test_a_manufactured_flow_over_and_in_a_graded_bed_has_second_order(order, least):
    """Linear elements by themselves, quadratic ones by the values of K in the middle of cells."""
    errors = [velocity_error(cells, order) for cells in (8, 16, 32)]
    print(order, errors, np.log2(errors[0] / errors[1]), np.log2(errors[1] / errors[2]))
    assert np.log2(errors[1] / errors[2]) > least


def test_pores_that_the_flow_closes_end_the_run():
    """The fluid is asked for nothing where k has no value: no warning of NumPy's before."""
    permeability = {"law": "holmes_mow", "intrinsic": K, "exponent": 0.5, "slope": 1.0}
    with pytest.raises(ConvergenceError, match="of the skeleton"):
        final(plug(8, permeability=permeability, law="neo_hookean", speed=1.2))


REFUSED = {
    "conditions of Robin": (
        {"coupling": {"scheme": "partitioned", "interface": "robin_neumann"}},
        "[coupling.interface]: received 'robin_neumann' with a porous material beside a free fluid,"
        " expected 'dirichlet_neumann'; leave it out",
    ),
    "a scheme without iteration": (
        {"coupling": {"scheme": "weak"}},
        "[coupling.scheme]: received 'weak' with a porous material beside a free fluid, expected"
        " 'partitioned', 'quasi_direct' or 'direct'",
    ),
    "a law without a moving mesh": (
        {"permeability": XIE_LEO, "model": {"moving_mesh": False}},
        "[material.1.permeability.law]: received 'xie_leo' with model.moving_mesh = false, where J"
        " = 1 and the law has no effect, expected 'constant', or true",
    ),
    "a porosity that the run decides on": (
        {"model": {"porosity": "auto"}},
        "[model.porosity]: received 'auto' beside a free fluid, expected 'constant' or 'variable'",
    ),
}


@pytest.mark.parametrize("changes, message", REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_is_refused(changes, message):
    with pytest.raises(InputError, match=re.escape(message)):
        load_scene(plug(**changes))


def test_a_constant_porosity_that_is_felt_has_its_limit():
    """In the density of the fluid, with inertia, convection or a body force."""
    felt = {"porosity": "constant", "convection": True}
    with pytest.raises(LimitError, match="porosity_change"):
        final(plug(permeability=XIE_LEO, model=felt))


@pytest.mark.parametrize("scheme", ["direct", "partitioned"])
def test_a_restart_goes_on_identically(tmp_path, scheme):
    scene = tmp_path / "plug.toml"
    changes = {"time": GROWING["time"] | {"end": 0.1}}
    scene.write_text(scene_to_toml(load_scene(plug(4, **GROWING | changes))))
    kept = ("output.checkpoint_every=1", f"coupling.scheme={scheme}", "coupling.tolerance=1e-7")
    run_here(Job(str(scene), str(tmp_path / "whole"), kept))
    half = tmp_path / "halves"
    run_here(Job(str(scene), str(half), ("time.end=0.06", *kept)))
    run_here(Job(str(scene), str(half), kept, restart=str(half / "checkpoint.h5")))
    whole, halves = (history(tmp_path / name) for name in ("whole", "halves"))
    for name, values in whole.items():
        assert halves[name].tolist() == values.tolist(), name


@needs_mpirun
@pytest.mark.parametrize("ranks, scheme", [(3, "direct"), (5, "partitioned")])
def test_the_ranks_do_not_matter(tmp_path, ranks, scheme):
    """The plug is on some of them alone."""
    scene = tmp_path / "plug.toml"
    changes = {"time": GROWING["time"] | {"end": 0.04}}
    scene.write_text(scene_to_toml(load_scene(plug(4, **GROWING | changes))))
    job = Job(str(scene), str(tmp_path / "many"), (f"coupling.scheme={scheme}",))
    run_on(ranks, [job], tmp_path)
    run_here(Job(str(scene), str(tmp_path / "one")))
    many, one = (history(tmp_path / name) for name in ("many", "one"))
    for column in ("face.u_x", "middle.u_x", "inlet.p"):
        assert many[column] == pytest.approx(one[column], rel=1e-6), column


def swept(scene, scheme, **coupling):
    """Return the history of a scene by a scheme, with residuals of 1e-9 of the forces."""
    choice = {"scheme": scheme, "tolerance": 1e-9, "max_iterations": 100, "on_failure": "stop"}
    with Simulation.from_scene(scene | {"coupling": choice | coupling}) as simulation:
        simulation.run()
        return simulation.history


PARTITIONED = {
    "steady": ({}, "iqn_ils", 12),
    "steady, Aitken": ({}, "aitken", 14),
    "in time": (GROWING, "iqn_ils", 30),
    "in time, Aitken": (GROWING, "aitken", 80),
    "of little permeability": (
        GROWING | {"permeability": XIE_LEO | {"intrinsic": 1e-8}, "speed": "0.01*t"},
        "iqn_ils",
        100,
    ),
}


@pytest.mark.parametrize("changes, accelerator, most", PARTITIONED.values(), ids=PARTITIONED)
def test_the_sweeps_end_in_the_solution_of_direct(changes, accelerator, most):
    """To 1e-6: the compliance of the plug in the drag makes hundreds of a residual of 1e-9."""
    scene = plug(8, **{"permeability": XIE_LEO} | changes)
    if "time" in changes:
        scene["time"] = scene["time"] | {"end": 0.06}
    wanted = swept(scene, "direct")
    found = swept(scene, "partitioned", accelerator=accelerator)
    sweeps = found["coupling_iterations"]
    print(accelerator, np.mean(sweeps), np.max(sweeps))
    assert np.max(sweeps) <= most
    for name in ("face.u_x", "middle.u_x", "inlet.p", "middle.p"):
        assert found[name][-1] == pytest.approx(wanted[name][-1], rel=1e-6), name


def test_sweeps_that_do_not_converge_end_the_run():
    """Aitken's one factor does not serve a drag of 5000 times the stiffness."""
    changes = PARTITIONED["of little permeability"][0]
    with pytest.raises(ConvergenceError, match=r'coupling\.scheme = "direct"'):
        swept(plug(8, **changes), "partitioned", accelerator="aitken", max_iterations=50)


POROUS_FLAP = (
    "material.1={region='flap', porosity=0.4,"
    " solid={law='neo_hookean', young=1e5, poisson=0.4, density=1000.0},"
    " fluid={density=1000.0, viscosity=1.0},"
    " permeability={law='kozeny_carman', intrinsic=1e-7}}",
    "model.porosity=variable",
    "coupling.tolerance=1e-9",
    "coupling.max_iterations=100",
    "time.end=0.05",
)


def test_a_porous_flap_in_a_channel_moves_alike_in_all_schemes():
    """With inertia, convection and a mesh that follows."""
    scene = str(SCENES / "flap.toml")
    tips = {}
    for scheme in ("direct", "quasi_direct", "partitioned"):
        tips[scheme] = final(load_scene(scene, (*POROUS_FLAP, f"coupling.scheme={scheme}")))
    print(tips)
    for scheme in ("quasi_direct", "partitioned"):
        for name in ("tip.u_x", "tip.u_y"):
            assert tips[scheme][name] == pytest.approx(tips["direct"][name], rel=1e-6), name
