"""The moving hand: a closed loop in view, of the requested coverage."""

import numpy as np
import pytest
import torch
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.research.benchmark.motion import MovingHand, silhouette_px

SIZE = (84, 128)


def test_the_motion_is_a_closed_loop_that_moves_and_stays_in_view(hand):
    motion = MovingHand(hand, SIZE)
    frames = motion.frames(24)
    vertices = np.stack([motion.shot(frame).vertices for frame in frames])
    steps_m = np.linalg.norm(vertices - np.roll(vertices, -1, 0), axis=-1).max(1)
    assert steps_m.min() > 1e-4
    assert steps_m.max() < 0.08  # the fist that opens, in four steps of 24
    for frame, posed in zip(frames, vertices, strict=True):
        pixels, depth = frame.camera.project(posed[hand.framed_vertices])
        assert depth.min() > 0.5
        assert pixels.min() > 0
        assert (pixels.max(0) < SIZE).all()


def test_the_motion_is_the_same_every_time_and_at_every_size(hand):
    (_, one), (_, other) = MovingHand(hand, SIZE).frames(2), MovingHand(hand, (168, 256)).frames(2)
    np.testing.assert_array_equal(one.pose.theta, other.pose.theta)
    np.testing.assert_allclose(other.camera.K[:2], 2 * one.camera.K[:2])
    np.testing.assert_array_equal(MovingHand(hand, SIZE).frames(2)[1].pose.theta, one.pose.theta)


@pytest.mark.parametrize(("coverage", "low", "high"), [(None, 0.27, 0.32), (0.1, 0.09, 0.11), (0.04, 0.035, 0.045)])
def test_the_hand_has_the_requested_coverage(hand, coverage, low, high):
    """The example's mean is 0.283 of 334x512, between 0.25 and 0.35."""
    motion = MovingHand(hand, SIZE, coverage)
    assert low < np.mean([motion.covered(frame) for frame in motion.frames(6)]) < high


def test_a_silhouette_agrees_with_the_rasteriser(hand):
    motion = MovingHand(hand, (167, 256))
    shot = motion.shot(motion.frames(3)[1])
    pixels, depth = (torch.as_tensor(v, dtype=torch.float32) for v in shot.camera.project(shot.vertices))
    exact = len(rasterise(pixels, depth, torch.as_tensor(hand.f), shot.camera.size_px).pixel.unique())
    assert silhouette_px(shot.vertices, hand.f, shot.camera) == pytest.approx(exact, rel=0.06)
