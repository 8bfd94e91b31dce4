"""A file as camera, in the tracker's own process: what it sees, how late, and that nothing outlives it."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system.camera_device import camera_device
from livehand.backend.tracking.live import CameraSource, LiveTracker

pytestmark = pytest.mark.usefixtures("networks")
PATIENCE_S = 90.0


@pytest.fixture
def watched(networks_folder):
    """A function: (path) -> a tracker of it as a camera; all are closed."""
    made = []

    def watch(path, is_file=True, hands=1):
        made.append(LiveTracker(CameraSource(str(path), is_file), hands, networks_folder))
        return made[-1]

    yield watch
    for tracker in made:
        tracker.close()
        assert not is_alive(tracker.pid)


def is_alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def frames_of(tracker, count=10**6):
    """The frames until the end, or so many."""
    found, until = [], time.monotonic() + PATIENCE_S
    while len(found) < count and not tracker.has_ended and time.monotonic() < until:
        if (frame := tracker.newest(wait_s=PATIENCE_S)) is not None:
            found.append(frame)
    return found


@pytest.fixture
def waved(film, shown):
    """A video of 40 frames in which a hand moves to the right; its picture tells the frame."""
    picture = np.ascontiguousarray(shown("palm")[::3, 160:1120:3])
    moved = [np.roll(picture, 2 * index, 1) for index in range(40)]
    for index, one in enumerate(moved):
        one[:16, :320] = 6 * index
    return film(moved)


@pytest.mark.slow
def test_picture_and_landmarks_are_of_one_frame_and_the_newest_wins(waved, networks_folder):
    """And what was recorded is a take, of true times."""
    tracker = LiveTracker(CameraSource(str(waved), True), 1, networks_folder)
    try:
        tracker.record()
        found = frames_of(tracker)
        assert len(found) > 3
        assert tracker.has_ended
        first = next(frame for frame in found if frame.hands)
        for frame in found:
            assert round(float(frame.picture[:10].mean()) / 6) == frame.index
            assert frame.size_px == (320, 240)
            if frame.hands:
                moved = (frame.hands[0].px - first.hands[0].px)[:, 0].mean()
                assert moved == pytest.approx(2 * (frame.index - first.index), abs=3)
        assert (np.diff([frame.index for frame in found]) > 0).all()
        recorded = tracker.recorded()
        assert set(recorded.hands) == {"right"}
        assert len(recorded.times) >= len(found)
        np.testing.assert_allclose(recorded.times[-1], (found[-1].index) / 30, atol=0.05)
        assert tracker.recorded() is None
    finally:
        tracker.close()
    assert not is_alive(tracker.pid)


@pytest.mark.slow
def test_whoever_waits_is_woken_by_a_frame_and_by_the_end(watched, waved):
    tracker = watched(waved)
    assert tracker.newest() is None  # the process has only begun
    began_s = time.monotonic()
    assert tracker.newest(wait_s=PATIENCE_S) is not None
    while not tracker.has_ended:
        tracker.newest(wait_s=PATIENCE_S)
    assert time.monotonic() - began_s < PATIENCE_S


@pytest.mark.slow
def test_a_killed_process_is_one_error(watched, waved):
    tracker, began_s = watched(waved), time.monotonic()
    os.kill(tracker.pid, signal.SIGKILL)
    with pytest.raises(LiveHandError, match=r"must go on, it ended \(signal 9\)"):
        frames_of(tracker)
    assert time.monotonic() - began_s < PATIENCE_S


@pytest.mark.slow
def test_what_is_no_video_or_no_camera_is_one_error(watched, tmp_path):
    (tmp_path / "a.mp4").write_text("no video")
    with pytest.raises(LiveHandError, match="must be a video"):
        frames_of(watched(tmp_path / "a.mp4"))
    with pytest.raises(LiveHandError, match="must be a camera that no other program uses"):
        frames_of(watched("/dev/video73", is_file=False))


@pytest.mark.slow
def test_a_file_that_breaks_off_ends(watched, waved):
    """A film whose index comes first is cut in the middle of its frames."""
    av = pytest.importorskip("av")
    cut = waved.with_suffix(".mkv")
    with av.open(str(waved)) as source, av.open(str(cut), "w") as container:
        stream = container.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(source.streams.video[0]):
            if packet.dts is not None:
                packet.stream = stream
                container.mux(packet)
    with av.open(str(cut)) as container:
        points = [packet.pos for packet in container.demux(video=0) if packet.dts is not None]
    cut.write_bytes(cut.read_bytes()[: points[20] + 10])  # half of the bytes may be less than the first frame
    tracker = watched(cut)
    found = frames_of(tracker)
    assert found
    assert found[-1].index < 39
    assert tracker.has_ended


@pytest.mark.slow
def test_it_ends_with_a_killed_parent(waved, networks_folder):
    """Nobody closes anything: the pipe of a killed process ends."""
    source = (
        "import sys, time; from livehand.backend.tracking.live import *; "
        f"one = LiveTracker(CameraSource({str(waved)!r}, True), 1); print(one.pid, flush=True); time.sleep(60)"
    )
    parent = subprocess.Popen([sys.executable, "-c", source], stdout=subprocess.PIPE, text=True)
    pid = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    until = time.monotonic() + PATIENCE_S
    while is_alive(pid) and time.monotonic() < until:
        time.sleep(0.05)
    assert not is_alive(pid)


def test_names_of_cameras():
    with pytest.raises(LiveHandError, match="number or a device's name"):
        camera_device("concat:a|b")
    if sys.platform == "linux":
        assert camera_device("2") == ("/dev/video2", "v4l2")
        assert camera_device("/dev/video1") == ("/dev/video1", "v4l2")
