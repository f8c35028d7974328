"""The public problems of docs/cases.md: the table names those of the scenes, and every community
has its share.
"""

import re
from collections import Counter

import pytest
from docs.cases import PAGE, table_of

from porofsi_petsc import list_scenes, load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.simulation import verify
from porofsi_petsc.simulation.verify import public_problems

PATHS = {name: path for name, _, path in list_scenes()}
SCENES = {name: load_scene(PATHS[name]) for name in public_problems()}
COMMUNITIES = (
    "consolidation",
    "soil dynamics",
    "biphasic tissue",
    "fluid-structure interaction",
    "haemodynamics",
)


def test_every_community_has_eight_problems_and_all_together_forty():
    count = Counter(scene.community for scene in SCENES.values())
    assert all(count[community] >= 8 for community in COMMUNITIES), count
    assert count.total() >= 40
    assert all(scene.expect for scene in SCENES.values())


def test_the_table_names_the_problems_of_the_scenes():
    rows = re.findall(r"^\| `(\w+)` \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(rows) == sorted(SCENES)


def test_the_table_gives_their_reference_values():
    """A value that was changed in a scene is changed in the table by making it again."""
    text = PAGE.read_text(encoding="utf-8")
    for name, scene in SCENES.items():
        row = next(line for line in text.splitlines() if line.startswith(f"| `{name}` |"))
        reference = float(row.split("|")[5])
        assert any(reference == pytest.approx(e.value, rel=1e-5) for e in scene.expect), name
        assert scene.title.split(" (exact")[0] in row


def test_a_row_has_the_value_that_is_nearest_to_its_bound():
    summary = {
        "title": "A column (exact: somebody)",
        "wall_time": {"total": 1.25},
        "expectations": [
            record("a", 1.0, 1.01, 0.01, 0.02),
            record("b", 2.0, 2.01, 0.005, 0.006),
            record("error.u", 0.0, 1e-3, 1e-3, 1e-3),
        ],
    }
    (row,) = table_of([("column", "Somebody 1900, doi:10.1/2", summary)])[2:]
    assert row == (
        "| `column` | A column | Somebody 1900, [doi:10.1/2](https://doi.org/10.1/2) | b final"
        " | 2 | 2.01 | 0.005 | 0.006 | 3 of 3 | 1.2 |"
    )


def record(quantity, reference, value, error, tolerance):
    """Return what summary.json has of an expectation at the end."""
    return {
        "quantity": quantity,
        "at": None,
        "since": None,
        "statistic": "final",
        "reference": reference,
        "value": value,
        "error": error,
        "tolerance": tolerance,
        "passed": error <= tolerance,
    }


@pytest.mark.parametrize(
    "change, sentence",
    [
        ("source=Somebody", "[source]: received 'Somebody', expected a citation"),
        ("community=soils", "[community]: received 'soils', expected one of"),
    ],
)
def test_a_public_problem_has_a_source(change, sentence):
    with pytest.raises(InputError, match=re.escape(sentence)):
        load_scene(PATHS["terzaghi"], (change,))


def test_a_problem_is_run_by_its_suite_and_no_other_scene(tmp_path):
    (check, *_) = verify(("sheet_pile",), tmp_path, suite="cases")
    assert check.case == "sheet_pile" and check.passed
    with pytest.raises(InputError, match="'pulse2d': received an unknown name"):
        verify(("pulse2d",), tmp_path, suite="cases")
    with pytest.raises(InputError, match="--quick: received it with --suite cases"):
        verify((), tmp_path, quick=True, suite="cases")
