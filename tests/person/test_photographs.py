"""Folders of photographs: turned, of any camera, broken or of nothing; one shape for all."""

import numpy as np
import pytest
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.person.photographs import pictures_of_photographs, read_photograph, read_photographs
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.hand_picture import HAND
from livehand.backend.tracking.tracked_hand import TrackedHand
from PIL import ExifTags, Image

pytestmark = pytest.mark.slow

pytest.importorskip("cv2", reason="OpenCV (the extra masks) is not installed")
ORIENTATION_TURNED = 6  # the camera was held upright; the file lies on its side


def save(picture, path, orientation=None, **tags):
    image = Image.fromarray(picture)
    exif = image.getexif()
    exif[ExifTags.Base.Software] = "ours"  # without an entry of its own, no part is written
    if orientation:
        exif[ExifTags.Base.Orientation] = orientation
    for name, value in tags.items():
        exif.get_ifd(ExifTags.IFD.Exif)[getattr(ExifTags.Base, name)] = value
    image.save(path, exif=exif)


@pytest.fixture(scope="module")
def person(shown, networks, hand, tmp_path_factory):
    """Pictures of two photographs, one turned with a known lens, beside a broken file and a text."""
    folder, told = tmp_path_factory.mktemp("photographs"), []
    save(np.ascontiguousarray(np.rot90(shown("palm"))), folder / "a.jpg", 6, FocalLengthIn35mmFilm=26)
    save(shown("back"), folder / "b.png")
    (folder / "c.jpg").write_bytes(b"no picture")
    (folder / "notes.txt").write_text("mine")
    return pictures_of_photographs(folder, hand, told.append, networks=networks), told


def test_photographs_become_pictures_of_one_shape(person):
    result, told = person
    first, second = result.pictures
    assert (result.side, first.name, second.name) == ("right", "a.jpg", "b.png")
    np.testing.assert_array_equal(first.pose.beta, second.pose.beta)
    assert np.abs(first.pose.beta).max() > 0.01
    assert [(one.scene, one.camera_index) for one in result.pictures] == [(0, 0), (1, 1)]
    assert told[-1] == "masking 2 pictures"


def test_the_hand_lies_where_its_pose_is(person, hand):
    for picture in person[0].pictures:
        is_hand = picture.labels == HAND
        px, _ = picture.camera.project(posed_vertices(hand, picture.pose)[hand.framed_vertices])
        column, row = px.mean(0).astype(int)
        assert is_hand[row - 5 : row + 6, column - 5 : column + 6].mean() > 0.9
        assert 0.15 < is_hand.mean() < 0.8
        assert picture.rgb[is_hand].mean(0)[0] > picture.rgb[is_hand].mean(0)[2]  # skin


def test_what_cannot_be_used_is_noted(person):
    notes = "\n".join(person[0].notes)
    assert "c.jpg cannot be read" in notes
    assert "1 photographs do not tell their focal length; 65 degrees are taken" in notes


def test_a_photograph_is_upright_with_the_lens_that_its_file_tells(tmp_path):
    picture = np.zeros((30, 40, 3), np.uint8)
    picture[:5] = 255
    save(picture, tmp_path / "a.png", ORIENTATION_TURNED, FocalLengthIn35mmFilm=26)
    found = read_photograph(tmp_path / "a.png")
    assert found.rgb.shape == (40, 30, 3)
    assert found.rgb[:, -5:].min() == 255
    assert (found.focal_px, found.is_guessed) == (pytest.approx(26 / np.hypot(36, 24) * 50), False)
    save(picture, tmp_path / "b.png", FocalLength=4.0, FocalPlaneXResolution=254.0, FocalPlaneResolutionUnit=2)
    assert read_photograph(tmp_path / "b.png").focal_px == pytest.approx(40)
    save(picture, tmp_path / "c.png", FocalLengthIn35mmFilm=0)
    assert read_photograph(tmp_path / "c.png").focal_px == pytest.approx(20 / np.tan(np.deg2rad(32.5)))
    told, known = (read_photographs(tmp_path, 90.0)[0][index] for index in (2, 1))
    assert (told.focal_px, known.focal_px) == (pytest.approx(20), pytest.approx(40))


def test_folders_without_photographs_are_told(tmp_path):
    with pytest.raises(LiveHandError, match="must lie in a folder"):
        read_photographs(tmp_path / "gone")
    with pytest.raises(LiveHandError, match="none that can be read: it has no JPEG, PNG or HEIC file"):
        read_photographs(tmp_path)
    (tmp_path / "a.jpg").write_bytes(b"no")
    with pytest.raises(LiveHandError, match=r"none that can be read: a\.jpg cannot be read"):
        read_photographs(tmp_path)


def test_no_hand_and_two_people_are_told(networks, hand, tmp_path, monkeypatch):
    save(np.full((60, 80, 3), 90, np.uint8), tmp_path / "wall.png")
    with pytest.raises(LiveHandError, match="must show a hand, got none in 1 photographs"):
        pictures_of_photographs(tmp_path, hand, lambda _: None, networks=networks)
    three = [TrackedHand(0, np.zeros((21, 2)), np.zeros((21, 3)), 1.0, 1.0)] * 3
    monkeypatch.setattr("livehand.backend.tracking.still.StillTracker.hands", lambda *_: three)
    with pytest.raises(LiveHandError, match="must show one person, got 3 hands in one picture"):
        pictures_of_photographs(tmp_path, hand, lambda _: None, networks=networks)
