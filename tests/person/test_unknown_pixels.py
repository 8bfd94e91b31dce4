"""What a picture does not tell is, in the capture that is trained on, what its person shows there."""

from dataclasses import replace

import numpy as np
from livehand.backend.capture.picture import srgb_to_linear
from livehand.backend.person.lit_capture import with_own_unknown
from livehand.backend.records.camera import Camera
from livehand.backend.records.frame import empty_frame
from livehand.backend.records.hand_picture import BACKGROUND, HAND, UNKNOWN, HandPicture
from livehand.backend.records.shot import HandPose


def test_unknown_pixels_are_the_persons_own_and_others_the_pictures():
    rng, size_px = np.random.default_rng(0), (6, 4)
    labels = np.full((4, 6), BACKGROUND, np.uint8)
    labels[:, 2:4], labels[:, 4:] = HAND, UNKNOWN
    rgb = rng.integers(20, 200, (4, 6, 3), dtype=np.uint8)
    gain = (0.2, 0.0, -0.3)
    picture = HandPicture("a", rgb, labels, Camera(np.eye(3), np.eye(4), size_px), HandPose.rest(), log_gain=gain)
    alpha = rng.uniform(0.2, 1, (4, 6)).astype(np.float32)
    straight = rng.uniform(0, 0.8, (4, 6, 3)).astype(np.float32)
    own = replace(empty_frame(size_px), rgb=straight * alpha[..., None], alpha=alpha)
    linear, found = with_own_unknown(picture, own)
    np.testing.assert_allclose(linear[:, 4:], straight[:, 4:], rtol=1e-5)
    np.testing.assert_array_equal(found[:, 4:], alpha[:, 4:])
    shown = srgb_to_linear(rgb.astype(np.float32) / 255) / np.exp(gain)
    np.testing.assert_allclose(linear[:, :4], shown[:, :4], rtol=1e-5)
    np.testing.assert_array_equal(found[:, :4], labels[:, :4] == HAND)
