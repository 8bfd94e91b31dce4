"""`livehand export` of files of poses, in formats that need no Blender."""

import json

import numpy as np
import pytest
from livehand.backend.commands import export
from livehand.backend.motion.files.open_files import open_motion_file
from livehand.backend.motion.formats.own import write_motion
from livehand.backend.motion.motion import HandMotion
from livehand.backend.motion.writers.registry import WRITERS
from livehand.livehand_blender import cli

pytestmark = pytest.mark.slow


@pytest.fixture
def take(tmp_path):
    rng = np.random.default_rng(0)
    motion = HandMotion(rng.normal(size=(5, 16, 3)) * 0.1, np.zeros(10), np.zeros((5, 3)), 25.0, "left")
    write_motion(motion, tmp_path / "take.npz")
    return tmp_path / "take.npz", motion


def run(*words):
    return cli.main(["export", *map(str, words), "--json"])


@pytest.mark.parametrize("name", [writer.name for writer in WRITERS])
def test_every_format_is_written(take, tmp_path, capsys, name):
    writer = next(writer for writer in WRITERS if writer.name == name)
    output = tmp_path / f"out{writer.suffixes[0]}"
    assert run(take[0], "-o", output, "--format", name) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["format"] == name
    assert (told["hands"], told["frames"], told["fps"]) == (["left"], 5, 25.0)
    assert output.stat().st_size > 500


def test_the_suffix_chooses_and_the_angles_stay(take, tmp_path):
    assert run(take[0], "-o", tmp_path / "out.csv") == 0
    back = open_motion_file(tmp_path / "out.csv").motion()
    np.testing.assert_allclose(back.theta, take[1].theta, atol=1e-9)


def test_a_file_of_landmarks_is_fitted_and_written(take, tmp_path, capsys):
    assert run(take[0], "-o", tmp_path / "points.json", "--format", "mediapipe") == 0
    assert run(tmp_path / "points.json", "-o", tmp_path / "out.npz") == 0
    assert open_motion_file(tmp_path / "out.npz").info.side == "left"


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["-o", "out.txt"], "suffix must be one of"),
        (["-o", "out.json", "--format", "mano"], r"must end in .npz"),
        (["-o", "out.csv", "--from-mean"], "--from-mean is of mano, whose angles"),
        (["-o", "out.npz", "--format", "mano", "--from-mean"], "hands_mean"),
        (["-o", "out.csv", "--frames", "1-2"], "--frames is of a .blend, got a file of poses; leave it out"),
        (["-o", "out.csv", "--splats", "5000"], "--splats is of splats, which alone consist of them, got csv"),
        (["-o", "out.bvh", "--views", "48"], "--views is of splats, which are fitted to views, got bvh"),
        (["-o", "out.bvh", "--view-size", "512"], "--view-size is of splats"),
        (
            ["-o", "out.csv", "--avatar", "light"],
            "--avatar is of fbx, gltf, usd and splats, which show a skin, got csv",
        ),
        (["-o", "out.csv", "--texture-size", "64"], "--texture-size is of fbx, gltf and usd"),
        (["-o", "out.npz", "--bones", "a.json"], "--bones is of --rig, which keys a character's bones, got livehand"),
        (["-o", "out.npz", "--arm", "FK"], "--arm is of --rig"),
        (["-o", "out.csv", "--fps", "-3"], "fps must be a positive number"),
    ],
)
def test_what_does_not_fit_is_refused_and_nothing_written(take, tmp_path, capsys, monkeypatch, more, message):
    monkeypatch.chdir(tmp_path)
    assert run(take[0], *more) == 1
    assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["take.npz"]


def test_a_file_without_a_rate_asks_for_one(tmp_path, capsys):
    write_motion(HandMotion(np.zeros((2, 16, 3)), np.zeros(10), np.zeros((2, 3))), tmp_path / "still.npz")
    assert run(tmp_path / "still.npz", "-o", tmp_path / "out.bvh") == 1
    assert "give them (--fps 30)" in capsys.readouterr().err
    assert run(tmp_path / "still.npz", "-o", tmp_path / "out.bvh", "--fps", "24") == 0
    assert "Frame Time: 0.0416666666666667" in (tmp_path / "out.bvh").read_text()


def test_the_command_names_every_format():
    assert export.FORMATS[: len(WRITERS)] == tuple(writer.name for writer in WRITERS)
