"""Scenes of solids and free fluids that ask for what there is not: one sentence that says where,
what and what to do.
"""

import json
import re
import sys

import meshio
import numpy as np
import pytest
from running import SCENES, Job, changes, complete, run_here

from porofsi_petsc import load_scene
from porofsi_petsc.errors import ConvergenceError, InputError
from porofsi_petsc.linalg.options import start
from porofsi_petsc.phases.solid import SolidPhase
from porofsi_petsc.simulation import check

FLAP = str(SCENES / "flap.toml")
POROUS = (
    "{region='flap', porosity=0.3, solid={law='linear_elastic', young=1e5, poisson=0.3,"
    " density=1e3},"
)
POROUS += " fluid={density=1e3, viscosity=1.0}, permeability={law='constant', intrinsic=1e-8}}"
FLUID = "{region='body', fluid={density=1e3, viscosity=1.0}}"
SOLID = "{region='flap', solid={law='linear_elastic', young=1e5, poisson=0.3, density=1e3}}"
CLOSED = (
    "boundary=[{on=['left','right','top','bottom'], velocity={x=0, y=0}, displacement={x=0, y=0}}]"
)
SPLIT_FLOOR = "mesh.patches=[{name='foot', side='bottom', x=[0.4, 0.5]}]"
SIDES = [
    "{on='left', velocity={x=1, y=0}}",
    "{on='right'}",
    "{on=['top','bottom'], velocity={x=0, y=0}}",
]


def sides(*entries):
    """Return the boundary of the channel with a foot of its own under the flap."""
    return f"boundary=[{', '.join([*SIDES, *entries])}]"


# changes -> what the sentence says: where, the key, received and expected, what to do
WRONG = {
    "neither solid nor fluid": (
        [f"material=[{FLUID}, {{region='flap'}}]"],
        (
            r"\[material\.1\]: received neither solid nor fluid, expected one of them, or both with"
            r" porosity and permeability"
        ),
    ),
    "porous solid, one way": (
        [f"material=[{FLUID}, {POROUS}]", "coupling.scheme=one_way"],
        (
            r"\[coupling\.scheme\]: received 'one_way' with a porous material beside a free"
            r" fluid, expected 'partitioned', 'quasi_direct' or 'direct'"
        ),
    ),
    "pressure": (
        [sides("{on='foot', pressure=0}"), SPLIT_FLOOR],
        r"\[boundary\.3\.pressure\]: .*; prescribe a traction",
    ),
    "flux": (
        [sides("{on='foot', flux=0}"), SPLIT_FLOOR],
        r"\[boundary\.3\.flux\]: .*; prescribe a velocity",
    ),
    "no slip": (
        [sides("{on='foot', no_slip=true}"), SPLIT_FLOOR],
        r"\[boundary\.3\.no_slip\]: .*; prescribe a velocity",
    ),
    "closed fluid": (
        [CLOSED, "coupling.interface='dirichlet_neumann'"],
        (
            r"\[coupling\.interface\]: received 'dirichlet_neumann' with a fluid that the solid"
            r" closes: .* no level; leave"
        ),
    ),
    "closed fluid that sees nothing": (
        [CLOSED, "coupling.scheme='one_way'"],
        (
            r"\[coupling\.scheme\]: received 'one_way' with a fluid that the solid closes: .* no"
            r" level; leave"
        ),
    ),
    "velocity on a solid": (
        [sides("{on='foot', velocity={x=0}}"), SPLIT_FLOOR],
        (
            r"\[boundary\.3\.velocity\.x\]: tag 'foot' is on the solid, expected a surface of the"
            r" fluid; prescribe a displacement"
        ),
    ),
    "traction on both": (
        [sides("{on='bottom', traction={x=1}}").replace("'top','bottom'", "'top'")],
        (
            r"\[boundary\.3\.traction\.x\]: tag 'bottom' is on fluid and solid, expected .* one of"
            r" them; give each part a tag"
        ),
    ),
    "traction beside a displacement of the solid": (
        [sides("{on='foot', displacement={x=0, y=0}}", "{on='foot', traction={y=1}}"), SPLIT_FLOOR],
        (
            r"\[boundary\.4\.traction\.y\]: tag 'foot' has boundary\.3\.displacement\.y already.*;"
            r" remove one of the two"
        ),
    ),
    "traction beside a velocity of the fluid": (
        [
            sides("{on='right', traction={x=1}}", "{on='right', velocity={x=1}}", "{on='foot'}"),
            SPLIT_FLOOR,
        ],
        (
            r"\[boundary\.4\.velocity\.x\]: tag 'right' has boundary\.3\.traction\.x already.*;"
            r" remove one of the two"
        ),
    ),
    "condition on the interface": (
        [sides("{on='interface', velocity={x=1}}")],
        (
            r"\[boundary\.3\.velocity\.x\]: tag 'interface' lies between solid and fluid, which set"
            r" the conditions there; remove it"
        ),
    ),
    "force on an unknown tag": (
        ["force=[{name='F', on='lid'}]"],
        (
            r"\[force\.0\.on\]: the mesh has no boundary tag 'lid'; choose from bottom, interface,"
            r" left, right, top"
        ),
    ),
    "force on a solid and a fluid": (
        [
            sides("{on='foot', displacement={x=0, y=0}}"),
            SPLIT_FLOOR,
            "force=[{name='F', on=['top', 'foot']}]",
        ],
        (
            r"\[force\.0\.on\]: received 'foot' on the solid and 'top' on the fluid, expected"
            r" surfaces of one of them; .*"
        ),
    ),
    "two forces of one name": (
        ["force=[{name='F', on='top'}, {name='F', on='left'}]"],
        r"\[force\.1\.name\]: received 'F', the name of another probe, force or surface",
    ),
    "a force and a probe of one name": (
        ["force=[{name='tip', on='top'}]"],
        r"\[force\.0\.name\]: received 'tip', the name of another probe, force or surface",
    ),
    "flow in the solid": (
        ["probe=[{name='P', at=[0.45, 0.1], quantities=['u_x', 'vf_x']}]"],
        (
            r"\[probe\.0\]: received vf_x at \(0\.45, 0\.1\) m in the solid, expected a point of"
            r" the fluid; .*"
        ),
    ),
    "pressure in the solid": (
        ["probe=[{name='P', at=[0.45, 0.1], quantities=['p']}]"],
        (
            r"\[probe\.0\]: received p at \(0\.45, 0\.1\) m in the solid, expected a point of the"
            r" fluid"
        ),
    ),
    "porosity without pores": (
        ["probe=[{name='P', at=[0.45, 0.1], quantities=['n_f']}]"],
        r"\[probe\.0\.quantities\]: received 'n_f' without porous materials; leave it out",
    ),
    "unknown law of the mesh": (
        ["mesh_motion.law=springs"],
        (
            r"\[mesh_motion\.law\]: received 'springs', expected one of linear_elastic, harmonic,"
            r" neo_hookean"
        ),
    ),
    "steady with inertia": (
        ["time.scheme=steady", "model.solid_inertia=true"],
        (
            r"\[time\.scheme\]: received 'steady' with inertia, expected model\.solid_inertia ="
            r" false and .*"
        ),
    ),
    "no viscosity": (
        ["model.viscosity=false"],
        (
            r"\[model\.viscosity\]: received false with a free fluid of"
            r" material\.0\.fluid\.viscosity = 1 Pa s, expected true, or"
        ),
    ),
    "a pair of conditions without an interface": (
        [f"material=[{FLUID.replace('body', 'all')}]", "coupling.interface=robin_neumann"],
        r"\[coupling\.interface\]: .*; leave it out",
    ),
    "a law of soils": (
        ["material.1.solid.law=xie_leo"],
        (
            r"\[material\.1\.solid\.law\]: received 'xie_leo', a law of soils, for a solid without"
            r" pores; choose another"
        ),
    ),
    "auto": (
        ["model.convection=auto"],
        r"\[model\.convection\]: received 'auto' without porous materials, expected true or false",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input_is_one_sentence(case):
    overrides, sentence = WRONG[case]
    start()
    with pytest.raises(InputError, match=sentence) as error:
        check(load_scene(FLAP, overrides))
    text = str(error.value)
    print(text)
    assert "\n" not in text and "flap.toml" in text


def test_regions_without_a_common_surface_are_refused(tmp_path):
    """Two blocks of a mesh file that lie against each other with nodes of their own."""
    points = np.array(
        [[x, y, 0.0] for x0 in (0.0, 1.0) for x, y in ((x0, 0), (x0 + 1, 0), (x0 + 1, 1), (x0, 1))]
    )
    triangles = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    lines = np.array([[a + b, a + (b + 1) % 4] for a in (0, 4) for b in range(4)])
    groups = {"flap": [1, 2], "body": [2, 2], "sides": [3, 1]}
    tags = [np.array([3] * 8), np.array([1, 1, 2, 2])]
    mesh = meshio.Mesh(
        points,
        [("line", lines), ("triangle", triangles)],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
    )
    mesh.field_data = {name: np.array(value) for name, value in groups.items()}
    mesh.write(tmp_path / "apart.msh", file_format="gmsh22", binary=False)
    given = (
        f"mesh={{kind='file', path='{tmp_path / 'apart.msh'}', dim=2}}",
        "boundary=[{on='sides'}]",
        "force=[]",
        "probe=[]",
    )
    start()
    with pytest.raises(
        InputError, match="solid and fluid have no surface in common; give them common nodes there"
    ):
        check(load_scene(FLAP, given))


def test_the_command_line_ends_with_two(tmp_path):
    overrides, sentence = WRONG["velocity on a solid"]
    words = [
        sys.executable,
        "-m",
        "porofsi_petsc",
        "run",
        FLAP,
        "--output",
        str(tmp_path / "run"),
        *changes(overrides),
    ]
    result = complete(words)
    assert (
        result.returncode == 2
        and re.search(sentence, result.stderr)
        and not (tmp_path / "run").exists()
    )


def test_a_scheme_that_diverges_says_what_to_do(tmp_path):
    """Dirichlet-Neumann without relaxation under a fluid as heavy as the flap."""
    given = (
        "coupling.accelerator=none",
        "coupling.interface=dirichlet_neumann",
        "coupling.on_failure=stop",
        "time.end=0.05",
    )
    with pytest.raises(
        ConvergenceError,
        match='accelerator = "iqn_ils", .*interface = "robin_neumann" .*scheme = "direct"',
    ) as error:
        run_here(Job(FLAP, str(tmp_path / "run"), given))
    assert "\n" not in str(error.value)
    print(error.value)
    assert error.value.what.startswith(
        "the sweeps of step 1 do not converge: an element of the mesh of the fluid is inverted"
    )
    assert (
        str(error.value) == f"{error.value.what}; {error.value.advice}"
    )  # that of the inverted element is replaced
    assert json.loads((tmp_path / "run/summary.json").read_text())["exit_code"] == 3


def test_sweeps_that_fail_without_an_advice_keep_the_cause(tmp_path, monkeypatch):
    """To the last word, semicolons of others included: a text of PETSc, say."""

    def failing(self, residual):
        raise ConvergenceError("its set-up failed: zero pivot; row 3")

    monkeypatch.setattr(SolidPhase, "correct", failing)
    with pytest.raises(
        ConvergenceError,
        match="^the sweeps of step 1 .*: its set-up failed: zero pivot; row 3; try coupling.acc",
    ):
        given = "time.end=0.01", "coupling.accelerator=aitken", "coupling.on_failure=stop"
        run_here(Job(FLAP, str(tmp_path / "run"), (*given, "coupling.interface=dirichlet_neumann")))
