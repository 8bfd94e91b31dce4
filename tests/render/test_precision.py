"""What bf16 costs in the image: two levels of 255 of colour times alpha, wherever the pixel lies.

Straight colours differ by more only where a pixel is nearly transparent, by those levels divided by alpha: up to all
255 where alpha rounds to 0 in one of the two, as colours of such pixels are what is left of a division by nothing.
"""

import numpy as np
import pytest
from livehand.backend.avatars.file import load_avatar
from livehand.backend.geometry.framing import fitting_camera
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.image.decode import straight_srgb
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.renderer import Renderer


@pytest.mark.slow
def test_bf16_and_fp32_differ_by_two_levels_of_colour_times_alpha_and_by_three_in_single_pixels(hand):
    theta = theta_of(GESTURES["relaxed"].angles_deg(), FingerAxes.of_default_hand())
    pose = HandPose(theta, np.zeros(10), np.zeros(3))
    vertices = posed_vertices(hand, pose)
    shot = Shot(pose, vertices, fitting_camera(vertices[hand.framed_vertices], (0.0, -1.0, 0.0), (96, 128), 0.9))
    avatar = load_avatar()
    exact, rough = (
        (straight_srgb(Renderer(avatar, hand, "cpu", precision).render(shot)) * 255).round()
        for precision in ("fp32", "bf16")
    )
    assert (exact[..., 3] == 255).sum() > 800
    premultiplied = [image[..., :3] * image[..., 3:] / 255 for image in (exact, rough)]
    is_seen = np.minimum(exact, rough)[..., 3] >= 64
    for difference in (
        np.abs(exact - rough)[..., 3],
        np.abs(premultiplied[0] - premultiplied[1]),
        np.abs(exact - rough)[is_seen],
    ):
        assert difference.max() <= 3
        assert (difference > 2).mean() < 1e-3
