"""Captures of an avatar's own frames."""

import numpy as np
import pytest
from livehand.backend.capture.capture import load_capture
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.records.frame import Frame
from livehand.backend.research.rendered_capture import CloseUps, render_capture

PLAN = CloseUps(poses=12, directions=4, field_m=0.06, size_px=8, seed=1, beta=(0.5,) + (0.0,) * 9)


class Painter:
    """Renders a gradient to the right in each 2 x 2 pixels, half covered."""

    def __init__(self, hand):
        self.hand, self.shots = hand, []

    def render(self, shot):
        self.shots.append(shot)
        width, height = shot.camera.size_px
        rgb = np.zeros((height, width, 3), np.float32)
        rgb[:, 1::2] = 0.2
        return Frame(rgb, np.tile(np.array([0, 1], np.float32), (height, width // 2)), np.zeros((height, width)))


@pytest.fixture(scope="module")
def planned(hand, tmp_path_factory):
    return PLAN.make(tmp_path_factory.mktemp("close"), hand, {"made_by": "test"})


def test_poses_and_directions_are_held_out(planned):
    splits = {split: planned.of_split(split) for split in ("train", "novel_pose", "novel_camera", "test")}
    assert {split: len(views) for split, views in splits.items()} == {
        "train": 33,
        "novel_pose": 3,
        "novel_camera": 11,
        "test": 1,
    }
    assert {view.pose_index for view in splits["test"]} == {5}
    assert all(pose.beta[0] == 0.5 for pose in planned.poses)


def test_every_camera_looks_at_skin_between_wrist_and_fingertips(planned, hand):
    for view in planned.views[::7]:
        vertices = posed_vertices(hand, planned.poses[view.pose_index])
        at_px, depth_m = view.camera.project(vertices)
        nearest = np.linalg.norm(at_px - 4, axis=1).argmin()
        assert np.linalg.norm(at_px[nearest] - 4) < 0.01
        assert depth_m[nearest] == pytest.approx(0.75, abs=1e-6)
        assert np.isclose(view.camera.K[0, 0] * 0.06 / 0.75, 8)
        assert hand.v_template[nearest, 0] < hand.joints[0, 0] + 0.03


def test_pictures_are_means_of_rendered_pixels_and_are_made_once(planned, hand):
    painter = Painter(hand)
    render_capture(planned, painter)
    assert len(painter.shots) == len(planned.views)
    shown, planned_camera = painter.shots[0].camera, planned.views[0].camera
    assert shown.size_px == (16, 16)
    assert np.allclose(shown.K[:2], 2 * planned_camera.K[:2])
    loaded = load_capture(planned.folder)
    assert loaded.provenance["plan"]["field_m"] == 0.06
    linear = loaded.read_linear(loaded.views[0])
    assert np.allclose(linear[..., 3], 0.5, atol=0.01)
    assert np.allclose(linear[..., :3], 0.1, atol=0.01)
    render_capture(planned, painter)
    assert len(painter.shots) == len(planned.views)
