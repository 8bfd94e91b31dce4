"""A small film of both sides of our own hand, whose camera moves, becomes pictures."""

import numpy as np
import pytest
from livehand.backend.person.film import is_held_out, pictures_of_film, unseen_note, usual_fov_deg
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.hand_picture import HAND, UNKNOWN

pytest.importorskip("cv2", reason="OpenCV (the extra masks) is not installed")


@pytest.mark.slow
def test_a_film_becomes_pictures(film, shown, networks, hand):
    sides = [shown(name)[::2, ::2] for name in ("palm", "back")]
    frames = [np.roll(side, 2 * shift, 1) for side in sides for shift in range(8)]
    told = []
    person = pictures_of_film(film(frames), hand, told.append, networks=networks, fov_deg=60.0)
    assert person.side == "right"
    assert 2 <= len(person.pictures) <= 16
    assert len({picture.scene for picture in person.pictures}) == 1
    assert len({tuple(picture.pose.beta) for picture in person.pictures}) == 1
    for picture in person.pictures:
        assert picture.pose.side == "right"
        assert picture.camera.K[0, 0] == pytest.approx(frames[0].shape[1] / 2 / np.tan(np.deg2rad(30)))
        assert ((picture.labels == HAND) | (picture.labels == UNKNOWN)).mean() > 0.15
    assert told[0] == "tracking the film"


@pytest.mark.slow
def test_a_film_without_a_hand_is_told(film, networks, hand):
    with pytest.raises(LiveHandError, match=r"must show a hand, got none in \d frames"):
        pictures_of_film(film([np.full((120, 160, 3), 90, np.uint8)] * 6), hand, lambda _: None, networks=networks)


def test_an_upright_film_shows_less_across_at_the_same_angle_along_it():
    assert usual_fov_deg((1280, 720)) == pytest.approx(65)
    assert usual_fov_deg((720, 1280)) == pytest.approx(39.43, abs=0.01)  # atan(720 / 1280 * tan(32.5 deg)), twice


def test_every_sixth_of_enough_pictures_is_held_out():
    assert [index for index in range(14) if is_held_out(index, 14)] == [3, 9]
    assert not any(is_held_out(index, 5) for index in range(5))


def test_skin_that_was_not_seen_is_noted():
    assert unseen_note(0.9) is None
    assert "show 43% of the hand's skin" in unseen_note(0.43)
