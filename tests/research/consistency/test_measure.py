"""A renderer that paints the skin is consistent; one that flickers is not, and the truth's own change is taken off."""

import numpy as np
import pytest
from livehand.backend.records.frame import Frame
from livehand.backend.research.consistency.measure import measure, motion_frames
from livehand.backend.research.consistency.warping import MeshView

SIZE, FRAMES, PER_TURN = (60, 80), 4, 96


class PaintedSkin:
    """Colours skin by its place on the template, linear; brighter by `flicker` in every other frame."""

    def __init__(self, hand, flicker=0.0):
        self.hand, self.flicker, self.count = hand, flicker, 0

    def render(self, shot, *, on_stage=lambda stage: None):
        places = MeshView(np.asarray(shot.vertices, float), self.hand.f, shot.camera).visible_points()
        template = (self.hand.v_template[self.hand.f[places.face]] * places.weights[..., None]).sum(1)
        rgb, alpha = np.zeros((SIZE[0] * SIZE[1], 3), np.float32), np.zeros(SIZE[0] * SIZE[1], np.float32)
        rgb[places.pixel] = 0.3 + 0.1 * np.sin(25 * template) + self.flicker * (self.count % 2)
        alpha[places.pixel] = 1
        self.count += 1
        shape = SIZE[::-1]
        return Frame(rgb.reshape(*shape, 3), alpha.reshape(shape), alpha.reshape(shape))


@pytest.mark.parametrize("name", ["turntable", "wave"])
def test_painted_skin_is_consistent_and_flicker_is_measured(hand, name):
    frames = motion_frames(name, hand, SIZE, FRAMES, PER_TURN)
    calm, flickering = (measure(PaintedSkin(hand, flicker), frames) for flicker in (0.0, 0.05))
    assert calm.pixels > 500
    assert calm.difference < 0.5
    assert calm.flicker < 0.5
    assert calm.beyond is None
    assert flickering.difference == pytest.approx(flickering.flicker, rel=0.05)
    assert 6 < flickering.flicker < 14  # 0.05 of linear light around 0.3


def test_the_truths_own_change_is_taken_off(hand):
    frames = motion_frames("turntable", hand, SIZE, FRAMES, PER_TURN)
    renderer = PaintedSkin(hand, 0.05)

    def truth(frame):
        from livehand.backend.evaluation.evaluate import encoded_on_black
        from livehand.backend.research.benchmark.motion import MovingHand

        return encoded_on_black(renderer.render(MovingHand(hand, SIZE).shot(frame)))

    found = measure(PaintedSkin(hand, 0.05), frames, truth)
    assert found.truth_difference == pytest.approx(found.difference, abs=1e-5)
    assert found.beyond == pytest.approx(0, abs=1e-5)
    calm = measure(PaintedSkin(hand), frames, truth)
    assert calm.beyond < -5


def test_a_turntable_turns_about_the_vertical_and_keeps_the_pose(hand):
    frames = motion_frames("turntable", hand, SIZE, 5, 4)
    positions = np.array([frame.camera.cam2world[:3, 3] for frame in frames])
    np.testing.assert_allclose(positions[4], positions[0], atol=1e-12)
    np.testing.assert_allclose(positions[1, :2], [-positions[0, 1], positions[0, 0]], atol=1e-12)
    np.testing.assert_allclose(positions[:, 2], positions[0, 2])
    assert all(frame.pose is frames[0].pose for frame in frames)
