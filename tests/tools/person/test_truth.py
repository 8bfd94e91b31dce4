"""The truth of a film: what is written is read, and what a drawing's surroundings are."""

import numpy as np
import pytest
from livehand.backend.capture.exr import write_exr
from livehand.tools.person.script import FPS, FRAMES, film_cameras
from livehand.tools.person.skin_points import skin_points
from livehand.tools.person.strangers import STRANGERS, ink
from livehand.tools.person.truth import drawn_texels, read_truth, write_truth

pytestmark = pytest.mark.slow


def test_what_is_written_is_read_for_every_third_frame(tmp_path):
    stranger, frames = STRANGERS["stranger1"], len(range(0, FRAMES, 3))
    gains, factor = np.full((frames, 3), 1.5), np.full((8, 8, 3), -0.5)
    write_truth(tmp_path, stranger, 3, gains, factor, np.eye(8, dtype=bool))
    truth = read_truth(tmp_path)
    assert truth.melanin == stranger.person.melanin
    assert len(truth.theta) == len(truth.transl) == len(truth.forearm) == len(truth.cameras) == frames
    np.testing.assert_array_equal(truth.cameras[2].cam2world, film_cameras()[6].cam2world)
    np.testing.assert_array_equal(truth.gains, gains)
    np.testing.assert_array_equal(truth.log_factor, factor)
    assert truth.drawn.sum() == 8
    with np.load(tmp_path / "truth.npz") as arrays:
        assert arrays["fps"] == pytest.approx(FPS / 3)
    assert truth.fps == pytest.approx(FPS / 3)


def test_pictures_are_in_the_order_of_their_numbers(tmp_path):
    (tmp_path / "scenes").mkdir()
    for number in (10, 9):
        write_exr(tmp_path / "scenes" / f"{number}.exr", {name: np.full((2, 3), number, np.float32) for name in "RGBA"})
    stranger = STRANGERS["stranger1"]
    write_truth(tmp_path, stranger, 36, np.ones((2, 3)), np.zeros((8, 8, 3)), np.zeros((8, 8), bool))
    pictures = read_truth(tmp_path).pictures()
    assert [picture.shape for picture in pictures] == [(2, 3, 4)] * 2
    assert [picture[0, 0, 0] for picture in pictures] == [9, 10]


def test_what_is_drawn_reaches_3_mm_beyond_the_ink_of_the_back():
    stranger, points = STRANGERS["stranger1"], skin_points(256)
    drawn = points.texels.from_map(drawn_texels(stranger, points)[..., None])[:, 0]
    for stroke in stranger.strokes:
        inked = ink(stroke, points.at_mm, points.normals) > 0.5
        assert drawn[inked].all() == stroke.is_dorsal
    inked = np.any([ink(one, points.at_mm, points.normals) > 0.5 for one in stranger.strokes if one.is_dorsal], 0)
    flat, ink_at = points.at_mm[:, [0, 2]], points.at_mm[inked][:, [0, 2]]
    farthest_mm = max(np.linalg.norm(ink_at - place, axis=1).min() for place in flat[drawn])
    assert 2.5 < farthest_mm < 4.6
