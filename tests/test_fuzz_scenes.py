"""scripts/run fuzz scenes: hostile scenes and overrides are refused in a sentence, and it finds
what is not.
"""

from collections import Counter
from unittest import mock

from fuzz import scenes as fuzzing

from porofsi_petsc.errors import InputError


def test_hostile_scenes_are_valid_or_refused_in_a_sentence():
    trial = fuzzing.fuzz(200, seed=1)
    print(dict(trial.counts))
    assert trial.findings == []
    assert (
        set(trial.counts) <= {"refused", "checked", "valid"}
        and trial.counts["refused"] > 100
        and trial.counts["checked"] > 20
    )


def test_a_case_is_the_same_whatever_was_tried_before():
    def texts(first, cases):
        made = []
        with mock.patch.object(
            fuzzing.Fuzz,
            "outcome",
            lambda self, *_: made.append(self.path.read_bytes()) or "valid",
        ):
            fuzzing.fuzz(cases, seed=3, first=first)
        return made

    assert texts(0, 6)[4:] == texts(4, 2)


def test_what_is_no_sentence_is_found():
    def found(error):
        with mock.patch.object(fuzzing, "load_scene", side_effect=error):
            return fuzzing.fuzz(1).findings[:1]

    assert found(InputError("[time.end]: received 0, expected a number > 0")) == []
    for error in (
        InputError("no place"),
        InputError("[a]: two\tcells"),
        InputError("[a]: " + "x" * 500),
        ZeroDivisionError("x"),
    ):
        assert len(found(error)) == 1
    assert Counter(problem.split(":")[0] for _, problem, _, _ in found(InputError("no place"))) == {
        "without a place": 1
    }
