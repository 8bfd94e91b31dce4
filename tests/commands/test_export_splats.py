"""`livehand export` of files of poses as splats."""

import json
import re

import numpy as np
import pytest
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.motion.formats.own import write_motion
from livehand.backend.motion.motion import HandMotion
from livehand.livehand_blender import cli

pytestmark = pytest.mark.slow
FEW = ("--splats", "2000", "--views", "12", "--view-size", "128")


@pytest.fixture
def take(tmp_path):
    axes = FingerAxes.of_default_hand()
    theta = np.array([theta_of(GESTURES[name].angles_deg(), axes) for name in ("relaxed", "open")])
    motion = HandMotion(theta, np.zeros(10), np.array([[0.3, 0.0, 0.2], [0.3, 0.1, 0.2]]), 25.0, "left")
    write_motion(motion, tmp_path / "take.npz")
    return tmp_path / "take.npz"


def run(*words):
    return cli.main(["export", *map(str, words), "--json"])


def positions_of(path):
    head, data = path.read_bytes().split(b"end_header\n", 1)
    columns = head.count(b"property float")
    return head.decode(), np.frombuffer(data, "<f4").reshape(-1, columns)[:, :3]


@pytest.mark.nightly
def test_a_take_is_a_numbered_sequence_with_its_avatars_name(take, tmp_path, capsys):
    assert run(take, "-o", tmp_path / "hand.ply", *FEW, "--avatar", "middle") == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["output"] == [str(tmp_path / f"hand_000{number}.ply") for number in (1, 2)]
    assert told["splats"] > 1500
    assert min(told["held_out_db"]) > 22
    head, first = positions_of(tmp_path / "hand_0001.ply")
    _, second = positions_of(tmp_path / "hand_0002.ply")
    assert "comment LiveHand/Avatar: middle" in head
    assert "comment LiveHand/PSNR:" in head
    # The same splats, moved with the hand: 0.1 m along Y, which the file has along Z.
    assert len(first) == len(second)
    assert 0.07 < np.median(second[:, 2] - first[:, 2]) < 0.13


@pytest.mark.nightly
def test_the_suffix_of_gltf_means_splats_where_the_format_says_so(tmp_path, capsys):
    write_motion(HandMotion(np.zeros((1, 16, 3)), np.zeros(10), np.zeros((1, 3)), 25.0, "right"), tmp_path / "pose.npz")
    assert run(tmp_path / "pose.npz", "-o", tmp_path / "hand.glb", "--format", "splats", *FEW) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["output"] == [str(tmp_path / "hand.glb")]
    assert b"KHR_gaussian_splatting:SCALE" in (tmp_path / "hand.glb").read_bytes()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["-o", "out.csv", "--format", "splats"], r"must end in \.ply or \.glb"),
        (["-o", "out.ply", "--splats", "5"], "splats' count must lie in 1000 to 500000"),
        (["-o", "out.ply", "--views", "3"], "splats' views must lie in 12 to 400"),
        (["-o", "out.ply", "--from-mean"], "--from-mean is of mano"),
        (["-o", "out.ply", "--texture-size", "64"], "--texture-size is of fbx, gltf and usd.*, got splats"),
        (["-o", "out.ply", "--arm", "IK"], "--arm is of --rig"),
        (["-o", "out.ply", "--rig", "a.blend"], "--rig is of motion"),
    ],
)
def test_wrong_options_are_refused(take, tmp_path, capsys, more, message):
    words = [str(tmp_path / word) if word.startswith("out.") else word for word in more]
    assert run(take, *words) == 1
    assert re.search(message, capsys.readouterr().err)
    assert not list(tmp_path.glob("out*"))
