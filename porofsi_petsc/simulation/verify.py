"""Verification cases: shipped scenes, with changes, judged by their [[expect]] or by the order with
which their errors fall.
"""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from mpi4py import MPI

from ..config import list_scenes, load_scene
from ..config.toml import read_toml
from ..errors import ConvergenceError, ExpectationError, InputError
from ..linalg.options import start
from ..output.files import on_root
from ..output.summary import NAME as SUMMARY
from .run import run


@dataclass(frozen=True)
class Check:
    """One line of the result: error is |computed - reference| over the scale of the expectation, or
    what is missing of an order.

    computed, error : None when the run failed, which `note` explains
    """

    case: str
    quantity: str
    computed: float | None
    reference: float
    error: float | None
    bound: float
    passed: bool
    note: str = ""


@dataclass(frozen=True)
class SceneCase:
    """A scene with changes; its expectations are the checks."""

    scene: str
    changes: tuple = ()
    quick: bool = False


@dataclass(frozen=True)
class OrderCase:
    """A scene on levels of refinement, each twice as fine as the one before; the errors against
    [reference] at the end count.

    orders : field (u, v or p) -> (order of theory, lowest accepted: what is left of higher orders
    on the levels)
    """

    scene: str
    levels: tuple
    orders: dict
    quick: bool = False


def _uniform(height, cells, *changes):
    """Return the changes that make a column of as many cells, each half as wide as high."""
    mesh = (
        f"mesh.x.points=[0.0, {height / cells / 2}]",
        f"mesh.y.points=[0.0, {height}]",
        f"mesh.y.cells=[{cells}]",
    )
    return (*mesh, "mesh.y.ratios=[1.0]", *changes)


def _graded_steps(end, count, growth, level):
    """Return the changes that reach the end in count 2^level steps, the last as every one longer
    than the one before.
    """
    steps = count * 2**level
    factor = growth ** (0.5**level)
    return (
        f"time.end={end}",
        f"time.step={end * (factor - 1) / (factor**steps - 1)}",
        f"time.growth={factor}",
        f"time.max_step={end}",
    )


def _drained(law, load, *changes):
    """Return the case of a law's end state, on the way to which inertia is of no account."""
    fixed = f"material.0.solid.law={law}", "limits.inertia=report"
    return SceneCase("drained_column", (*fixed, *_loaded(load), *changes), quick=True)


def _loaded(load):
    return f"boundary.2.traction.y={-load}", f"reference.load={load}"


def _grid(*cells, **changes):
    """Return the changes that make a mesh of as many cells along its axes."""
    mesh = (f"mesh.{axis}.cells=[{count}]" for axis, count in zip("xyz", cells, strict=False))
    return (*mesh, *(f"time.{key}={value}" for key, value in changes.items()))


SMALL_STRAIN = ("model.moving_mesh=false", "model.porosity=constant")
LARGE_STRAIN = (
    "material.0.solid.law=neo_hookean",
    "model.moving_mesh=true",
    "limits.reynolds=report",
)
EULER = ("time.scheme=backward_euler",)
# At the end of `drained` and `selfweight` runs only errors count: the scene's probe values are
# those of another law.
ONLY_ERRORS = (
    "expect=[{ quantity = 'error.u', statistic = 'final', value = 0.0, scale = 1.0, tolerance ="
    " 1e-6 }]"
)
SLOW_DRAINAGE = ("time.end=90.0", "time.growth=1.1", "time.max_step=5.0", "limits.reynolds=report")
CRYER_EXPECT = """expect=[
    { quantity = 'error.u', at = 0.5, value = 0.0, scale = 1.0, tolerance = 6e-3 },
    { quantity = 'error.p', at = 0.5, value = 0.0, scale = 1.0, tolerance = 5e-3 },
    { quantity = 'error.u', at = 1.2, value = 0.0, scale = 1.0, tolerance = 3e-3 },
    { quantity = 'error.p', at = 1.2, value = 0.0, scale = 1.0, tolerance = 3e-3 }]"""
DOMAIN = {
    20: (
        "mesh.x.points=[0, 1, 4, 20]",
        "mesh.y.points=[-20, -4, -1, 0]",
        "mesh.x.ratios=[0.3, 4, 10]",
        "mesh.y.ratios=[0.1, 0.25, 0.3]",
    ),
    40: (),
}

CASES = {
    "column_step": SceneCase("column_step"),
    "column_harmonic": SceneCase("column_harmonic"),
    "column_step_low_permeability": SceneCase("column_step_low_permeability"),
    "terzaghi": SceneCase("terzaghi", quick=True),
    "mandel": SceneCase("mandel"),
    "unconfined_compression": SceneCase("unconfined_compression"),
    "cartilage_creep": SceneCase("cartilage_creep", quick=True),
    "cartilage_relaxation": SceneCase("cartilage_relaxation", quick=True),
    "cartilage_unconfined": SceneCase("cartilage_unconfined", quick=True),
    "cartilage_confined": SceneCase("cartilage_confined", quick=True),
    "cartilage_permeation": SceneCase("cartilage_permeation", quick=True),
    "cartilage_indentation": SceneCase("cartilage_indentation", quick=True),
    "layered_column": SceneCase("layered_column", quick=True),
    "rubber_sheet": SceneCase("rubber_sheet", quick=True),
    "artery_biaxial": SceneCase("artery_biaxial", quick=True),
    "footing_collapse": SceneCase("footing_collapse", quick=True),
    "strip_footing": SceneCase("strip_footing"),
    "cryer": SceneCase("cryer"),
    "cryer_axisymmetric": SceneCase("cryer_axisymmetric", quick=True),
    "cryer_poisson_0": SceneCase("cryer", ("material.0.solid.poisson=0.0", CRYER_EXPECT)),
    "cryer_poisson_025": SceneCase("cryer", ("material.0.solid.poisson=0.25", CRYER_EXPECT)),
    "seabed": SceneCase("seabed"),
    "xie_leo": SceneCase("xie_leo"),
    "selfweight_column": SceneCase("selfweight_column", quick=True),
    "selfweight_large_strain": SceneCase(
        "selfweight_column", (*LARGE_STRAIN, "reference.times=[]", ONLY_ERRORS)
    ),
    "drained_linear_elastic": _drained("linear_elastic", 3e5, *SMALL_STRAIN),
    "drained_saint_venant_kirchhoff": _drained("saint_venant_kirchhoff", 2e6),
    "drained_neo_hookean": _drained("neo_hookean", 7.5e6),
    "drained_neo_hookean_j2": _drained("neo_hookean_j2", 3e6),
    "drained_xie_leo": _drained("xie_leo", 3e6),
    "drained_ehlers_eipper": _drained("ehlers_eipper", 3e6),
    "ehlers_eipper_1": SceneCase("ehlers_eipper", ("material.0.permeability.exponent=1.0",)),
    "ehlers_eipper_2": SceneCase("ehlers_eipper"),
    "ehlers_eipper_5": SceneCase(
        "ehlers_eipper", ("material.0.permeability.exponent=5.0", *SLOW_DRAINAGE)
    ),
    "cook_membrane": SceneCase("cook_membrane", quick=True),
    "terzaghi_order_p1": OrderCase(
        "terzaghi",
        tuple(
            _uniform(10.0, 8 * 2**i, "mesh.order=1", *_graded_steps(20.0, 30, 1.2, i))
            for i in range(3)
        ),
        {"u": (2.0, 1.8), "p": (2.0, 1.8)},
        quick=True,
    ),
    "terzaghi_order_dt": OrderCase(
        "terzaghi",
        tuple(_graded_steps(20.0, 15, 1.5, i) for i in range(3)),
        {"u": (2.0, 1.8), "p": (2.0, 1.8)},
    ),
    "terzaghi_order_dt_euler": OrderCase(
        "terzaghi",
        tuple((*EULER, *_graded_steps(20.0, 15, 1.5, i)) for i in range(3)),
        {"u": (1.0, 0.9), "p": (1.0, 0.9)},
    ),
    "column_harmonic_order": OrderCase(
        "column_harmonic",
        tuple(_uniform(10.0, 40 * 2**i, f"time.step={1e-3 / 2**i}") for i in range(3)),
        {"u": (2.0, 1.8), "p": (2.0, 1.8)},
    ),
    "xie_leo_order_dt": OrderCase(
        "xie_leo",
        tuple(_graded_steps(2.0, 20, 1.4, i) for i in range(3)),
        {"u": (2.0, 1.8), "p": (2.0, 1.8)},
    ),
    "strip_footing_domain": OrderCase("strip_footing", (DOMAIN[20], DOMAIN[40]), {"p": (1.0, 0.9)}),
    "cavity": SceneCase("cavity", quick=True),
    "perpendicular_flap": SceneCase("perpendicular_flap"),
    "schaefer_turek_2d1": SceneCase("schaefer_turek_2d1", quick=True),
    "schaefer_turek_2d2": SceneCase("schaefer_turek_2d2"),
    "schaefer_turek_3d1": SceneCase("schaefer_turek_3d1"),
    "kovasznay": SceneCase("kovasznay", quick=True),
    "taylor_green": SceneCase("taylor_green", quick=True),
    "ethier_steinman": SceneCase("ethier_steinman"),
    "kovasznay_order_linear": OrderCase(
        "kovasznay",
        tuple((*_grid(24 * 2**i, 16 * 2**i), "mesh.order=1") for i in range(3)),
        {"v": (2.0, 1.7), "p": (1.0, 0.9)},
    ),
    "kovasznay_order_quadratic": OrderCase(
        "kovasznay",
        tuple(_grid(12 * 2**i, 8 * 2**i) for i in range(3)),
        {"v": (3.0, 2.7), "p": (2.0, 1.8)},
    ),
    "taylor_green_order_dt": OrderCase(
        "taylor_green",
        tuple(_grid(16, 16, step=0.2 / 2**i) for i in range(3)),
        {"v": (2.0, 1.8), "p": (2.0, 1.8)},
    ),
    "ethier_steinman_order": OrderCase(
        "ethier_steinman", tuple(_grid(n, n, n) for n in (3, 6)), {"v": (3.0, 2.7), "p": (2.0, 1.8)}
    ),
}


def public_problems() -> dict[str, SceneCase | OrderCase]:
    """Return the shipped scenes with a `community`, of docs/cases.md, by name."""
    return {
        name: SceneCase(name)
        for name, _, path in list_scenes()
        if read_toml(path).get("community") is not None
    }


# name of a suite -> its cases, by name
SUITES: dict[str, Callable[[], dict[str, SceneCase | OrderCase]]] = {
    "program": lambda: CASES,
    "cases": public_problems,
}


def verify(
    names: Sequence[str], directory: Path, quick: bool = False, suite: str = "program"
) -> list[Check]:
    """Run the named cases of a suite (all without a name, the short ones when quick) and return
    their checks (collective).

    directory : where each case writes (pathlib.Path).  Raises InputError for an unknown name,
    and for quick beside another suite than that of the program.
    """
    if quick and suite != "program":
        raise InputError(
            f"verify --quick: received it with --suite {suite}, expected it without; leave it out,"
            " or name the cases that are to run"
        )
    cases = SUITES[suite]()
    for name in names:
        if name not in cases:
            raise InputError(
                f"verification case '{name}': received an unknown name, expected one of"
                f" {', '.join(cases)}"
            )
    chosen = names or [name for name, case in cases.items() if case.quick or not quick]
    return [check for name in chosen for check in run_case(name, cases[name], directory / name)]


def run_case(name: str, case: SceneCase | OrderCase, directory: Path) -> list[Check]:
    """Run one case and return its checks (collective)."""
    try:
        if isinstance(case, OrderCase):
            return _order_checks(name, case, directory)
        return [
            _expectation_check(name, record)
            for record in _summary(case.scene, case.changes, directory)["expectations"]
        ]
    except ConvergenceError as error:
        return [Check(name, "run", None, 0.0, None, 0.0, False, str(error))]


def _summary(scene, changes, directory):
    """Run a scene and return its summary, whatever its expectations say."""
    loaded = load_scene(scene, changes)
    start(loaded.petsc.options, [])
    try:
        return run(loaded, directory, force=True, quiet=True)
    except ExpectationError:
        return on_root(
            MPI.COMM_WORLD, lambda: json.loads((directory / SUMMARY).read_text(encoding="utf-8"))
        )


def _expectation_check(name, record):
    when = f"at {record['at']:g} s" if record["at"] is not None else record["statistic"]
    since = f"since {record['since']:g} s " if record["since"] is not None else ""
    note = record["reason"] or record["source"]
    values = record["value"], record["reference"], record["error"], record["tolerance"]
    return Check(name, f"{record['quantity']} {since}{when}", *values, bool(record["passed"]), note)


def _order_checks(name, case, directory):
    """Return a check for every step between levels and every field."""
    summaries = [
        _summary(case.scene, ("expect=[]", "probe=[]", *level), directory / str(i))
        for i, level in enumerate(case.levels)
    ]
    errors = [summary["errors"][-1] for summary in summaries]
    checks = []
    for field, (theory, lowest) in case.orders.items():
        for i, (coarse, fine) in enumerate(zip(errors, errors[1:], strict=False)):
            order = math.log2(coarse[field] / fine[field])
            note = f"error.{field} {coarse[field]:.2e} -> {fine[field]:.2e}"
            missing = max(theory - order, 0.0)
            bound = theory - lowest
            checks.append(
                Check(
                    name,
                    f"order of {field}, level {i + 1}",
                    order,
                    theory,
                    missing,
                    bound,
                    missing <= bound,
                    note,
                )
            )
    return checks


def as_json(checks: Iterable[Check]) -> str:
    """Return the checks as JSON text, one object each."""
    return json.dumps([asdict(check) for check in checks], indent=2)
