"""What is measured of a film: colours of the real hand alone, though the avatar stands beside it."""

import numpy as np
import pytest
from livehand.backend.commands.reenact.film_look import measured_look
from livehand.backend.commands.reenact.filmed_shots import FilmedShots
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.landmarks.take_fit import FilmCamera, TakeFit
from livehand.backend.motion.motion import HandMotion
from livehand.backend.records.frame import DEPTH_BACKGROUND, Frame
from livehand.backend.render.renderer import Renderer
from livehand.backend.tracking.video import VideoFrame

HAND, FILM = load_default_hand(), FilmCamera((96, 72), 90.0)
GROUND, SKIN = (90, 200, 230), (200, 150, 100)


class Disc(Renderer):
    """A renderer of white discs, lit by no light."""

    is_relightable = False

    def render(self, shot, *_):
        alpha = disc(shot, 0)
        return Frame(alpha[..., None].repeat(3, -1), alpha, np.where(alpha > 0, 0.5, DEPTH_BACKGROUND))


def disc(shot, aside_px):
    (centre,), _ = shot.camera.project(shot.vertices.mean(0, keepdims=True))
    width, height = shot.camera.size_px
    x, y = np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5
    return (np.hypot(x - centre[0] - aside_px, y - centre[1]) < 7).astype(np.float32)


@pytest.mark.parametrize("aside_px", [0, 8])
def test_the_gain_is_of_the_real_hand_and_not_of_the_ground(aside_px):
    theta = np.zeros((3, 16, 3))
    theta[:, 0] = np.array([1, 1, 1]) * 2 * np.pi / 3 / np.sqrt(3)
    transl = np.array([[-0.2, 0.1, 0.5], [0.0, 0.1, 0.5], [0.2, 0.1, 0.5]])
    fit = TakeFit(HandMotion(theta, np.zeros(10), transl, 30.0), 0.0, np.ones(3, bool), np.zeros(3), 0)
    shots = FilmedShots.of(fit, FILM, HAND)
    frames = []
    for index in range(3):
        real = disc(shots.shot(index), aside_px)[..., None]
        frames.append(VideoFrame(index / 30, (GROUND * (1 - real) + SKIN * real).astype(np.uint8)))
    look = measured_look(iter(frames), 3, [shots], [object.__new__(Disc)])
    np.testing.assert_array_equal(look.plate, np.broadcast_to(GROUND, look.plate.shape))
    linear = ((np.array(SKIN) / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(look.gains[0], np.tile(linear, (len(look.times), 1)), rtol=0.01)
    assert len(look.times) >= 2
    assert not look.textures[0].grain.any()
