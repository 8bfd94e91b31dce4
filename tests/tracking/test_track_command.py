"""`livehand track` and `livehand reenact` from the video to the file."""

import json
import os
import signal
import sys
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.capture.capture import load_capture
from livehand.backend.capture.check import check_capture
from livehand.backend.commands import track
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.files.open_files import open_motion_file
from livehand.backend.records.errors import LiveHandError
from livehand.backend.tracking import sighted_take
from livehand.backend.tracking.tracker import HandTracker
from livehand.backend.tracking.video import open_video
from livehand.livehand_blender.cli import main
from PIL import Image

pytest.importorskip("av", reason="PyAV (the extra video) is not installed")
pytestmark = [pytest.mark.usefixtures("networks"), pytest.mark.slow]


@pytest.fixture(autouse=True)
def _in_the_users_folder(networks_folder, tmp_path, monkeypatch):
    """The networks where the commands look for them."""
    folder = tmp_path / "data" / "livehand" / "tracker"
    folder.parent.mkdir(parents=True)
    folder.symlink_to(networks_folder)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


@pytest.mark.slow
def test_a_video_becomes_a_take(film, two_hands, tmp_path, capsys):
    take = tmp_path / "take.npz"
    assert main(["track", str(film([two_hands] * 6)), "-o", str(take), "--fov", "60", "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert set(result["hands"]) == {"right", "left"}
    assert result["hands"]["right"]["keyed"] == 6
    file = open_motion_file(take)
    assert file.take.camera.focal_px == pytest.approx(320 / np.tan(np.pi / 6))
    assert len(file.motion(load_default_hand())) == 6


@pytest.mark.slow
def test_no_hand_is_one_clear_error_and_no_file(film, tmp_path, capsys):
    black = np.zeros((48, 64, 3), np.uint8)
    assert main(["track", str(film([black] * 3)), "-o", str(tmp_path / "take.npz")]) == 1
    assert "must show a hand, got none in 3 frames" in capsys.readouterr().err
    assert not (tmp_path / "take.npz").exists()


def test_what_is_no_video(tmp_path, capsys):
    (tmp_path / "a.mp4").write_text("text")
    assert main(["track", str(tmp_path / "a.mp4"), "-o", str(tmp_path / "take.npz")]) == 1
    assert "a.mp4 must be a video" in capsys.readouterr().err


@pytest.mark.slow
def test_a_video_is_reenacted(film, shown, tmp_path):
    """The avatar has the place and, within a few levels, the colour of the hand that it replaces."""
    picture = np.ascontiguousarray(shown("palm")[::3, 160:1120:3])
    out = tmp_path / "out"
    assert main(["reenact", str(film([picture] * 2)), "-o", str(out), "--side-by-side", "--device", "cpu"]) == 0
    pages = sorted(out.iterdir())
    assert [page.name for page in pages] == ["0001.png", "0002.png"]
    page = np.asarray(Image.open(pages[1])).astype(int)
    before, after = page[:, :320], page[:, 320:]
    is_hand, is_avatar = (np.ptp(side, axis=-1) > 25 for side in (before, after))
    assert (is_hand & is_avatar).sum() > 0.7 * is_hand.sum()
    assert np.abs(np.median(before[is_hand], 0) - np.median(after[is_avatar], 0)).max() < 25


@pytest.mark.slow
def test_a_turning_hand_becomes_a_capture(film, shown, tmp_path, capsys):
    """The picture is turned before a grey ground: frames of a hand that turns in the picture's plane."""
    pytest.importorskip("cv2", reason="OpenCV (the extra masks) is not installed")
    picture = Image.fromarray(np.ascontiguousarray(shown("palm")[::3, 160:1120:3]))
    ground = tuple(np.asarray(picture)[5, 5].tolist())
    turned = [
        np.asarray(picture.rotate(angle, Image.Resampling.BICUBIC, fillcolor=ground)) for angle in range(-50, 51, 4)
    ]
    folder = tmp_path / "capture"
    command = ["track", str(film(turned)), "-o", str(tmp_path / "take.npz"), "--capture", str(folder), "--json"]
    assert main(command) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    capture = load_capture(folder)
    assert result["images"] == len(capture.views) >= 20
    check_capture(capture, load_default_hand())
    assert len({pose.beta.tobytes() for pose in capture.poses}) == 1
    assert result["overlap"] > 0.8
    assert 0.3 < result["covered"] < 0.6  # of one side
    assert main(command) == 1
    assert "a new capture needs an empty folder" in capsys.readouterr().err


def test_a_still_hand_is_told_before_it_is_tracked(film, shown, tmp_path, capsys, monkeypatch):
    pytest.importorskip("cv2", reason="OpenCV (the extra masks) is not installed")
    monkeypatch.setattr(HandTracker, "track", lambda *_: pytest.fail("it was tracked"))
    still = [np.roll(shown("palm")[::2, ::2], shift, 1) for shift in range(8)]  # it moves, and does not turn
    folder = tmp_path / "capture"
    assert main(["track", str(film(still)), "-o", str(tmp_path / "t.npz"), "--capture", str(folder)]) == 1
    assert "a hand that turns, got a still one" in capsys.readouterr().err
    assert not folder.exists()


@pytest.mark.slow
def test_no_hand_leaves_no_capture(film, tmp_path, capsys):
    pytest.importorskip("cv2", reason="OpenCV (the extra masks) is not installed")
    black, folder = np.zeros((48, 64, 3), np.uint8), tmp_path / "capture"
    assert main(["track", str(film([black] * 3)), "-o", str(tmp_path / "t.npz"), "--capture", str(folder)]) == 1
    assert "must show a hand, got none in 3 frames" in capsys.readouterr().err
    assert not folder.exists()


def test_what_a_capture_needs_is_asked_before_the_video_is_read(tmp_path, capsys, monkeypatch):
    missing = [str(tmp_path / "no.mp4"), "-o", str(tmp_path / "take.npz")]
    assert main(["track", *missing, "--side", "left"]) == 1
    assert "--side names the hand of a capture, got no --capture" in capsys.readouterr().err
    (tmp_path / "mine.txt").write_text("mine")
    assert main(["track", *missing, "--capture", str(tmp_path)]) == 1
    assert "a new capture needs an empty folder" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "cv2", None)
    assert main(["track", *missing, "--capture", str(tmp_path / "new")]) == 1
    assert 'install it with: pip install "livehand[masks]"' in capsys.readouterr().err


@pytest.mark.slow
def test_a_film_whose_clock_jumps_is_tracked_in_its_own_frames(film, two_hands, tmp_path, capsys):
    """The motion would have three million frames, and take gigabytes."""
    jumped = [index / 30 + (95_443 if index >= 4 else 0) for index in range(8)]
    take = tmp_path / "take.npz"
    assert main(["track", str(film([two_hands] * 8, "film.mkv", times=jumped)), "-o", str(take), "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out.splitlines()[-1])["hands"]["right"]["keyed"] == 8
    assert "its clock jumps by 95443 s after frame 4" in err
    assert len(open_motion_file(take).motion(load_default_hand())) == 8


@pytest.mark.slow
def test_the_take_is_there_before_it_is_fitted(film, two_hands, tmp_path, monkeypatch, capsys):
    def fail(*arguments):
        raise LiveHandError("the landmarks must be a hand's")

    monkeypatch.setattr(track, "fit_take", fail)
    assert main(["track", str(film([two_hands] * 6)), "-o", str(tmp_path / "take.npz")]) == 1
    assert "must be a hand's" in capsys.readouterr().err
    assert len(open_motion_file(tmp_path / "take.npz").take.times) == 6


@pytest.mark.slow
@pytest.mark.parametrize(("moment", "is_there"), [("tracking", False), ("fitting", True)])
def test_sigterm_is_heard(film, two_hands, tmp_path, monkeypatch, capsys, moment, is_there):
    def stop(*arguments):
        os.kill(os.getpid(), signal.SIGTERM)

    if moment == "tracking":
        monkeypatch.setattr(HandTracker, "track", stop)
    else:
        monkeypatch.setattr(track, "fit_take", stop)
    assert main(["track", str(film([two_hands] * 6)), "-o", str(tmp_path / "take.npz")]) == 130
    assert (tmp_path / "take.npz").exists() == is_there
    assert "interrupted" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["track", "reenact"])
def test_a_film_that_is_too_long_is_an_error_before_it_is_tracked(
    film, two_hands, tmp_path, monkeypatch, capsys, command
):
    monkeypatch.setattr(HandTracker, "track", lambda *arguments: pytest.fail("tracked"))
    monkeypatch.setattr(sighted_take, "MOST_FRAMES", 5)
    assert (
        main([command, str(film([two_hands] * 6)), "-o", str(tmp_path / "out.npz" if command == "track" else tmp_path)])
        == 1
    )
    assert "must have at most 5 frames, got 6; cut it into parts" in capsys.readouterr().err


def test_a_film_that_is_longer_than_it_says_ends_with_a_warning(film, two_hands, monkeypatch, capsys):
    monkeypatch.setattr(sighted_take, "MOST_FRAMES", 5)
    video = replace(open_video(film([two_hands] * 8)), count=0)
    assert len(list(sighted_take.frames_of_film(video))) == 5
    assert "a take lasts at most 5 frames; those after frame 5 are left out" in capsys.readouterr().err
