"""A share of the kills in every run of the tests, and planted faults that are seen."""

import random
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
import run

NIGHTLY = pytest.mark.nightly


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kills"),
    [
        ("import", 2),
        *(pytest.param(name, kills, marks=NIGHTLY) for name, kills in (("train", 1), ("containers", 1), ("person", 2))),
    ],
)
def test_a_command_that_is_killed_ends_as_an_undisturbed_one(tmp_path, name, kills):
    survivor = run.Survivor(name, tmp_path / name, random.Random(0))
    survivor.run(kills)
    assert survivor.complaints == []
    assert survivor.kills == kills


WRITER = """
import json, sys, time
from pathlib import Path
folder = Path(sys.argv[-1])
is_repeated = (folder / "begun.json").exists()
(folder / "begun.json").write_text("{}")
(folder / "half.json").write_text('{"half":')
print(json.dumps({"event": "frame", "frame": 1, "state": "written"}), flush=True)
time.sleep(0 if is_repeated else 3)
(folder / "half.json").write_text(json.dumps(is_repeated))
"""


@pytest.mark.slow
def test_files_that_are_half_there_differ_or_are_written_twice_are_seen(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "HERE", tmp_path)
    (tmp_path / "small_livehand.py").write_text(WRITER)
    monkeypatch.setitem(run.COMMANDS, "planted", run.Killed(lambda inputs: []))
    survivor = run.Survivor("planted", tmp_path / "planted", random.Random(1))
    survivor.run(1)
    text = "\n".join(survivor.complaints)
    assert survivor.kills == 1
    for seen in ("half.json is not whole", "half.json differs", "written twice: [1]"):
        assert seen in text
