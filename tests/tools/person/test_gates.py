"""Gates: their verdicts, and what they measure of an avatar against a truth of known answers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.avatars.network_albedo import in_network_colours
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.spaces import rest_wrists
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import Shot
from livehand.backend.render.renderer import Renderer
from livehand.backend.surface.albedo_ratio import RATIO_STEP
from livehand.tools.person.gates import (
    Gate,
    SceneFigures,
    compared,
    contrast_gates,
    hand_pixels,
    number_gates,
    pose_gates,
    poses_in_cameras,
    resized,
)
from livehand.tools.person.measures import PictureFigures
from livehand.tools.person.script import FPS, FRAMES, film_cameras, film_motion, kept_scenes
from livehand.tools.person.truth import Truth

pytestmark = pytest.mark.slow

BETA = np.linspace(-0.5, 0.5, 10)


@pytest.fixture(scope="module")
def hand():
    return load_default_hand()


@pytest.fixture(scope="module")
def truth(hand):
    motion = film_motion(hand, BETA, 7)
    rng = np.random.default_rng(0)
    factor = (rng.uniform(size=(32, 32, 1)) > 0.5).repeat(16, 0).repeat(16, 1) * np.array([-1.5, -1.2, -0.7])
    drawn = np.zeros((512, 512), bool)
    drawn[100:400, 100:400] = True
    cameras = tuple(film_cameras())
    given = motion.theta, BETA, motion.transl, motion.forearms.copy(), cameras, np.ones((FRAMES, 3)), factor, drawn, FPS
    return Truth(Path(), 0.5, *given)


@pytest.mark.parametrize(
    ("gate", "passes"),
    [
        (Gate("a", 1.0), None),
        (Gate("a", 1.0, least=1.0), True),
        (Gate("a", 0.9, least=1.0), False),
        (Gate("a", 1.1, 0.9, 1.05), False),
        (Gate("a", float("nan"), most=1.0), False),
    ],
)
def test_a_gate_passes_within_its_limits(gate, passes):
    assert gate.passes is passes
    assert ("FAILS" in gate.line()) == (passes is False)


def test_fitted_poses_that_are_true_have_no_error_in_their_cameras_axes(truth, hand):
    frames = [0, 11, 40]
    poses = poses_in_cameras(truth, frames, hand)
    for frame, pose in zip(frames, poses, strict=True):
        world = posed_vertices(hand, _pose(truth, frame))
        to_camera = np.linalg.inv(truth.cameras[frame].cam2world)
        in_camera = world @ to_camera[:3, :3].T + to_camera[:3, 3]
        np.testing.assert_allclose(posed_vertices(hand, pose), in_camera, atol=1e-9)
    assert [gate.value for gate in pose_gates(poses, frames, truth, hand)] == pytest.approx([0, 0, 0], abs=1e-5)
    bent = [replace(pose, theta=pose.theta + BEND) for pose in poses]
    tips, wrist, fingers = (gate.value for gate in pose_gates(bent, frames, truth, hand))
    assert tips > 0.5
    assert wrist == pytest.approx(0, abs=1e-5)
    assert 0.2 < fingers <= 1.001


BEND = np.zeros((16, 3))
BEND[5, 1] = np.deg2rad(15)


def _pose(truth, frame):
    scene = kept_scenes(load_default_hand(), truth.beta)[0]
    return replace(scene.pose, theta=truth.theta[frame], transl=truth.transl[frame], forearm=truth.forearm[frame])


def test_numbers_and_the_tattoo_of_a_surface(truth):
    avatar = in_network_colours(load_avatar(shipped_avatar_path("light")))
    assert [gate.value for gate in number_gates(avatar, truth)] == [0.5]
    steps = (truth.log_factor / RATIO_STEP).round().repeat(2, 0).repeat(2, 1).astype(np.int8)
    surface = replace(avatar.surface, arrays={**avatar.surface.arrays, "albedo/ratio": steps})
    melanin, tattoo = number_gates(replace(avatar, surface=surface), truth)
    assert not melanin.passes
    assert tattoo.value == pytest.approx(1, abs=1e-3)
    with pytest.raises(LiveHandError, match="must have a surface"):
        number_gates(replace(avatar, surface=None), truth)


def test_the_arm_is_not_measured(hand):
    scene = kept_scenes(hand, BETA)[5]
    mask = hand_pixels(Shot(scene.pose, posed_vertices(hand, scene.pose), scene.camera), hand)
    wrist_px, _ = scene.camera.project(scene.pose.transl + rest_wrists(hand, BETA))
    assert mask.sum() > 5000
    assert not mask[round(wrist_px[1]) + 60 :].any()


def test_an_avatar_that_made_the_truth_is_perfect(truth, hand, monkeypatch):
    avatar = load_avatar(shipped_avatar_path("light"))
    shots = truth.scenes(hand, BETA)[:1]
    frame = Renderer(avatar, hand, "cpu").render(shots[0])
    monkeypatch.setattr(Truth, "scenes", lambda self, hand, beta: shots)
    monkeypatch.setattr(Truth, "pictures", lambda self: [np.concatenate([frame.rgb, frame.alpha[..., None]], -1)])
    (found,) = compared(avatar, truth, hand, BETA)
    assert found.figures.psnr_db > 90
    assert found.figures.flip < 1e-3
    assert found.figures.iou == 1
    assert found.contrast["seen"]["l_2_4"] == pytest.approx(1)
    assert found.contrast["unseen"] == {}


def test_contrast_is_averaged_by_side_over_the_pixels_that_show_it():
    figures = PictureFigures(30.0, 0.1, 0.9)
    rows = contrast_gates(
        [
            SceneFigures(figures, {"seen": {"l_1_2": 1.0}, "unseen": {}}, {"seen": 1000, "unseen": 7}),
            SceneFigures(figures, {"seen": {"l_1_2": 1.3}, "unseen": {"l_1_2": 0.8}}, {"seen": 3000, "unseen": 500}),
        ]
    )
    assert [row.value for row in rows] == pytest.approx([1.225, 0.8])
    assert [row.passes for row in rows] == [False, True]


def test_maps_are_halved_by_means_and_doubled_by_repetition():
    image = np.arange(16.0).reshape(4, 4)
    np.testing.assert_array_equal(resized(image, 2), [[2.5, 4.5], [10.5, 12.5]])
    np.testing.assert_array_equal(resized(image, 8)[::2, ::2], image)
    with pytest.raises(LiveHandError, match="power of two"):
        resized(image, 3)
