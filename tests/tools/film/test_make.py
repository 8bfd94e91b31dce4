"""The film is its cuts in order, with captions, and goes on where it was stopped."""

import numpy as np
import pytest
from livehand import api
from livehand.tools.film import cuts, make
from livehand.tools.film.cut import Cut, FilmSet, captioned, eased, side_by_side
from PIL import Image

av = pytest.importorskip("av")


def plain(color):
    return lambda film_set: lambda share: np.full((film_set.size_px[1], film_set.size_px[0], 3), color, np.uint8)


@pytest.fixture
def two_cuts(monkeypatch):
    cuts = (Cut("dark", "", 1.0, plain(60)), Cut("bright", "", 2.0, plain(200)))
    monkeypatch.setattr(make, "CUTS", cuts)
    return cuts


def levels_of(path):
    with av.open(str(path)) as film:
        return np.array([frame.to_ndarray(format="rgb24").mean() for frame in film.decode(video=0)])


def test_cuts_come_in_order_out_of_black_and_into_it(two_cuts, tmp_path):
    make.main([str(tmp_path / "film.mp4"), "--width", "160", "--rate", "12"])
    levels = levels_of(tmp_path / "film.mp4")
    assert len(levels) == 36
    np.testing.assert_allclose(levels[5:7], 60, atol=4)
    np.testing.assert_allclose(levels[20:28], 200, atol=4)
    assert levels[[0, 11]].max() < 30
    assert levels[[12, 35]].max() < 60


def test_what_was_drawn_is_not_drawn_again(two_cuts, tmp_path, monkeypatch):
    arguments = [str(tmp_path / "film.mp4"), "--width", "160", "--rate", "4"]
    make.main(arguments)
    (lost,) = (tmp_path / "film" / "bright").glob("*_00003.png")
    lost.unlink()
    drawn = []
    monkeypatch.setattr(make, "CUTS", tuple(cut._replace(prepare=counting(drawn)) for cut in two_cuts))
    make.main(arguments)
    assert drawn == [3 / 8]


def test_a_preview_shows_four_pictures_of_each_cut(monkeypatch, tmp_path):
    brighter = Cut(
        "brighter", "", 2.0, lambda film_set: lambda share: np.full((90, 160, 3), round(240 * share), np.uint8)
    )
    monkeypatch.setattr(make, "CUTS", (brighter,))
    preview = tmp_path / "film.webp"
    make.main([str(tmp_path / "film.mp4"), "--width", "160", "--rate", "4", "--preview", str(preview)])
    with Image.open(preview) as shown:
        assert (shown.n_frames, shown.size) == (4, (640, 360))
        levels = []
        for index in range(4):
            shown.seek(index)
            levels.append(np.asarray(shown.convert("RGB")).mean())
    np.testing.assert_allclose(levels, [30, 90, 150, 210], atol=4)


def counting(drawn):
    def draw(share):
        drawn.append(share)
        return np.zeros((90, 160, 3), np.uint8)

    return lambda film_set: draw


def test_a_caption_is_bright_and_stands_low_at_the_left():
    picture = np.full((540, 960, 3), 90, np.uint8)
    change = np.argwhere(np.abs(captioned(picture, "LiveHand").astype(int) - 90).max(-1) > 40)
    assert change[:, 0].min() > 450
    assert change[:, 1].max() < 400
    assert captioned(picture, "LiveHand").max() > 230


def test_a_picture_fills_the_film_and_is_magnified_about_its_middle(tmp_path):
    ramp = np.tile(np.linspace(0, 255, 300)[None, :, None], (200, 1, 3)).astype(np.uint8)
    film_set = FilmSet((160, 90), 12, tmp_path)
    whole, near = film_set.fitted(Image.fromarray(ramp)), film_set.fitted(Image.fromarray(ramp), 2.0)
    assert whole.shape == near.shape == (90, 160, 3)
    assert abs(int(whole[45, 80, 0]) - int(near[45, 80, 0])) <= 1
    assert np.ptp(near[45, :, 0].astype(int)) == pytest.approx(np.ptp(whole[45, :, 0].astype(int)) / 2, abs=3)


def test_halves_stand_side_by_side_and_motions_end_at_rest():
    both = side_by_side(np.full((4, 8, 3), 10, np.uint8), np.full((4, 8, 3), 20, np.uint8))
    assert both[0, :, 0].tolist() == [10, 10, 10, 0, 0, 20, 20, 20]
    steps = np.diff([eased(share) for share in np.linspace(0, 1, 101)])
    assert steps.sum() == pytest.approx(1)
    assert max(steps[0], steps[-1]) < 0.05 * steps.max()


def test_a_hand_rests_at_each_pose_of_a_row():
    start, end = (cuts._between(("Open", "Fist"), share) for share in (0.0, 0.999))
    for pose, name in ((start, "Open"), (end, "Fist")):
        np.testing.assert_allclose(pose.theta[1:], api.named_pose(name).theta[1:], atol=0.02)


@pytest.mark.nightly
@pytest.mark.parametrize("cut", cuts.CUTS[:6], ids=lambda cut: cut.name)
def test_every_cut_of_hands_shows_one_in_the_middle(cut, tmp_path):
    draw = cut.prepare(FilmSet((192, 108), 12, tmp_path))
    for share in (0.0, 0.55, 0.97):
        picture = draw(share).astype(int)
        red, blue = picture[20:88, 40:152, 0], picture[20:88, 40:152, 2]
        assert (red - blue > 12).mean() > 0.05
