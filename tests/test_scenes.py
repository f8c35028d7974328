"""Every shipped scene runs in its short form and leaves what a run leaves."""

import json

import pytest

from porofsi_petsc import list_scenes, load_scene, run
from porofsi_petsc.output.history import read_history

SCENES = {name: path for name, _, path in list_scenes()}


@pytest.mark.parametrize("name", SCENES)
def test_shipped_scene_runs_in_short_form(name, tmp_path):
    scene = load_scene(SCENES[name], smoke=True)
    summary = run(scene, tmp_path, quiet=True)
    history = read_history(tmp_path / "history.csv")
    assert history["t"][-1] == scene.end
    assert json.loads((tmp_path / "summary.json").read_text())["exit_code"] == 0
    # Newton's and the coupling tolerance leave 1e-6 of the forces of every step; their power sums
    # to less than 1e-4 of the work.
    assert summary["energy"]["balance_error_relative"] < 1e-4
    assert load_scene(tmp_path / "scene.toml") == scene
    assert (tmp_path / "histories.png").stat().st_size > 0
