"""Videos as phones and cameras write them, and as nobody should: what comes out, or one clear error."""

import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.tracking.takes import track_frames
from livehand.backend.tracking.tracker import HandTracker
from livehand.backend.tracking.video import HLG, PQ, open_video, tone_mapped

pytest.importorskip("av", reason="PyAV (the extra video) is not installed")


def moving(shown, count=6, size=(320, 180)):
    """The hand, a few pixels farther each frame."""
    picture = shown("palm")[::4, ::4]
    return [np.roll(picture, 3 * index, 1)[: size[1], : size[0]] for index in range(count)]


def patched_matrix(path, matrix):
    """The film's track header with another display matrix, as phones write it."""
    raw = bytearray(path.read_bytes())
    place = raw.index(b"tkhd") + 4 + 4 + 4 + 4 + 4 + 4 + 4 + 8 + 8
    raw[place : place + 36] = np.array(matrix, ">i4").tobytes()
    path.write_bytes(raw)


def test_frames_have_their_pictures_and_times(film, shown):
    pictures = moving(shown)
    video = open_video(film(pictures))
    frames = list(video.frames())
    assert (round(video.fps), video.count) == (30, 6)
    np.testing.assert_allclose([frame.time_s for frame in frames], np.arange(6) / 30, atol=1e-3)
    for frame, picture in zip(frames, pictures, strict=True):
        assert np.abs(frame.picture.astype(int) - picture).mean() < 4


def test_a_rate_that_varies_keeps_its_true_times(film, shown):
    times = [0, 0.017, 0.137, 0.17, 0.2, 0.3]
    frames = list(open_video(film(moving(shown), times=times)).frames())
    np.testing.assert_allclose([frame.time_s for frame in frames], times, atol=1e-3)


@pytest.mark.parametrize(("most_fps", "kept"), [(60.0, [0, 1, 2, 3, 4, 5]), (15.0, [0, 2, 4]), (10.0, [0, 3])])
def test_a_thinned_film_has_frames_at_equal_times(film, shown, most_fps, kept):
    video = open_video(film(moving(shown)))
    frames, thinned = list(video.frames()), list(video.thinned(most_fps))
    assert [frame.time_s for frame in thinned] == [frames[index].time_s for index in kept]
    for frame, index in zip(thinned, kept, strict=True):
        np.testing.assert_array_equal(frame.picture, frames[index].picture)


@pytest.mark.parametrize("name", ["film.mp4", "film.mkv", "film.ts"])
def test_a_clock_that_jumps_by_a_day_costs_one_frame_and_a_warning(film, shown, name, capsys):
    jumped = [index / 30 + (80_000 if index >= 5 else 0) for index in range(8)]
    video = open_video(film(moving(shown, count=8), name, times=jumped))
    assert (video.fps, video.count) == (30, 8)
    frames = list(video.frames())
    np.testing.assert_allclose([frame.time_s for frame in frames], np.arange(8) / 30, atol=2e-3)
    assert f"{video.path}: its clock jumps by 80000 s after frame 5; each jump" in capsys.readouterr().err


def test_broken_time_stamps_are_named(film, shown, capsys):
    pictures = moving(shown, count=4) * 30
    broken = open_video(film(pictures, times=[index / 1080 for index in range(120)]))
    assert f"{broken.path}: its time stamps give {broken.fps:.4g} frames a second" in capsys.readouterr().err
    open_video(film(pictures, times=[index / 200 for index in range(120)]))
    assert "broken" not in capsys.readouterr().err


CLOCKWISE = [0, 1 << 16, 0, -(1 << 16), 0, 0, 180 << 16, 0, 1 << 30]
HALF_A_TURN = [-(1 << 16), 0, 0, 0, -(1 << 16), 0, 0, 0, 1 << 30]


@pytest.mark.parametrize(("matrix", "quarters"), [(CLOCKWISE, -1), (HALF_A_TURN, 2)])
def test_a_turned_phone_is_turned_back(film, shown, matrix, quarters):
    pictures = moving(shown)
    path = film(pictures)
    patched_matrix(path, matrix)
    frame = next(iter(open_video(path).frames()))
    expected = np.rot90(pictures[0], quarters)
    assert frame.picture.shape == expected.shape
    assert np.abs(frame.picture.astype(int) - expected).mean() < 4


def test_ten_bits(film, shown):
    pictures = moving(shown)
    frame = next(iter(open_video(film(pictures, codec="libx265", pixels="yuv420p10le")).frames()))
    assert np.abs(frame.picture.astype(int) - pictures[0]).mean() < 4


def test_hlg_is_tone_mapped(film, shown):
    pictures = moving(shown)
    path = film(pictures, codec="libx265", pixels="yuv420p10le", color_trc=HLG)
    frame = next(iter(open_video(path).frames()))
    coarse = np.repeat(pictures[0].astype(np.uint16)[..., :1], 3, -1) * 257
    assert frame.picture.shape == pictures[0].shape
    grey = frame.picture.astype(float).mean(-1)
    assert np.corrcoef(grey.ravel(), tone_mapped(coarse, HLG).mean(-1).ravel())[0, 1] > 0.95


def test_tone_mapping_of_greys():
    """Black stays black, diffuse white (HLG 75 %, PQ 58 %) comes near white, brighter light stays below it."""
    ramp = np.repeat((np.linspace(0, 1, 101) * 65535).astype(np.uint16)[None, :, None], 3, -1)
    for transfer, white in ((HLG, 75), (PQ, 58)):
        mapped = tone_mapped(ramp, transfer)[0].astype(int)
        assert mapped[0].max() == 0
        assert (np.diff(mapped[:, 1]) >= 0).all()
        assert 225 < mapped[white, 1] < 250
        assert np.ptp(mapped, axis=-1).max() <= 1


@pytest.mark.parametrize("content", [b"", b"no video at all\n" * 200, bytes(range(256)) * 40])
def test_what_is_no_video(tmp_path, content):
    path = tmp_path / "a.mp4"
    path.write_bytes(content)
    with pytest.raises(LiveHandError, match=r"a\.mp4 must be a video"):
        open_video(path)


def test_missing_files_folders_and_pictures(tmp_path):
    with pytest.raises(LiveHandError, match="must be a readable file"):
        open_video(tmp_path / "none.mp4")
    with pytest.raises(LiveHandError, match="must be a regular file"):
        open_video(tmp_path)


def test_playlists_are_not_followed(tmp_path):
    path = tmp_path / "a.m3u8"
    path.write_text("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfile:///etc/passwd\n#EXT-X-ENDLIST\n")
    with pytest.raises(LiveHandError, match="must be a video"):
        open_video(path)


def test_a_film_that_breaks_off_keeps_what_came(film, shown):
    path = film(moving(shown, 40), name="a.mkv")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 3 // 4])
    frames = list(open_video(path).frames())
    assert 1 < len(frames) < 40


def test_flipped_bytes_are_frames_or_an_error(film, shown):
    path = film(moving(shown, 20))
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    for _ in range(8):
        raw = bytearray(whole)
        for place in rng.integers(0, len(raw), 60):
            raw[place] = rng.integers(256)
        path.write_bytes(raw)
        try:
            frames = list(open_video(path).frames())
        except LiveHandError:
            continue
        times = np.array([frame.time_s for frame in frames])
        assert (np.diff(times) > 0).all()


@pytest.mark.slow
def test_hands_are_put_together_by_side(film, two_hands, networks):
    found = track_frames(open_video(film([two_hands] * 6)).frames(), HandTracker(networks))
    assert set(found.hands) == {"right", "left"}
    assert found.size_px == (640, 360)
    for hand in found.hands.values():
        assert hand.frames.tolist() == list(range(6))
    assert found.hands["right"].px[..., 0].mean() < 320 < found.hands["left"].px[..., 0].mean()
