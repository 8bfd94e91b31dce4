"""`livehand.api`: its example, and what it refuses."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from livehand import api
from livehand.backend.hand.model import MIRROR_POINT
from livehand.backend.motion.formats.own import write_motion
from PIL import Image

pytestmark = pytest.mark.slow

EXAMPLE = Path(__file__).parents[1] / "examples" / "program.py"


@pytest.fixture(scope="module")
def person():
    return api.load_person("light")


def test_the_example_renders_pictures(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["program.py", str(tmp_path), "--size", "96", "--frames", "2"])
    runpy.run_path(str(EXAMPLE))
    first, second = (np.array(Image.open(tmp_path / f"{number}.png")).astype(float) for number in (0, 1))
    assert first.shape == (96, 96, 4)
    assert 0.1 < (first[..., 3] > 128).mean() < 0.9
    assert first[first[..., 3] > 250][:, :3].mean() > 30
    assert np.abs(first - second).mean() > 2  # the hand turns


def test_the_light_is_the_callers(person):
    pose, size_px = api.named_pose("Open"), (64, 64)
    camera = person.camera(pose, size_px)
    dim, bright = (
        person.render(pose, camera, api.Light((), api.Sky(np.full((2, 4, 3), radiance)))).rgb for radiance in (0.1, 0.4)
    )
    assert bright.sum() == pytest.approx(4 * dim.sum(), rel=0.02)


def test_a_left_hand_is_the_mirror_image(person):
    right, left = (person.vertices(api.named_pose("Point", side)) for side in ("right", "left"))
    np.testing.assert_allclose(left, right * MIRROR_POINT, atol=1e-6)


def test_the_wrist_turns_the_hand_in_the_world(person):
    wrists = None, np.array([0, 0, np.pi / 2])
    still, turned = (person.vertices(api.named_pose("Fist", wrist=wrist)) for wrist in wrists)
    joint = person.hand.joints[0]
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(turned - joint, (still - joint) @ quarter.T, atol=1e-6)


def test_a_hand_grasps_a_wall_before_its_palm(person):
    """The palm of an upright hand looks to the back, +Y."""
    pose = api.named_pose("Open")
    palm_m = person.vertices(pose)[person.hand.arm_weights == 0][:, 1].max()
    wall = trimesh.creation.box((0.5, 0.02, 0.5)).apply_translation((0, palm_m + 0.03, 0.1))
    grasp = person.grasp(pose, wall.vertices, wall.faces, api.GraspOptions(("index", "middle")))
    assert {"index", "middle"} <= set(grasp.touches)
    reached_m = person.vertices(grasp.pose)[person.hand.arm_weights == 0][:, 1].max()
    assert reached_m == pytest.approx(palm_m + 0.02, abs=0.001)


def test_a_motion_is_read(tmp_path, person):
    theta = np.random.default_rng(0).normal(size=(3, 16, 3)) * 0.1
    write_motion(api.HandMotion(theta, np.zeros(10), np.zeros((3, 3)), 30.0, "left"), tmp_path / "a.npz")
    motion = api.load_motion(tmp_path / "a.npz")
    assert (motion.side, len(motion), motion.fps) == ("left", 3, 30.0)
    np.testing.assert_allclose(motion.pose(1).theta, theta[1])


def test_what_is_not_there_is_named():
    with pytest.raises(api.LiveHandError, match=r"a pose must be one of .*Fist.*, got 'fist'"):
        api.named_pose("fist")
    with pytest.raises(api.LiveHandError, match=r"none\.safetensors"):
        api.load_person("none.safetensors")


def test_all_that_is_promised_is_there():
    assert all(hasattr(api, name) for name in api.__all__)
