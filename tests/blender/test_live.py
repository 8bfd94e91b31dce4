"""Hands that follow a file as camera: posed without keys, keyed once; every end leaves no process and no picture."""

import os
import signal
import time
from fractions import Fraction
from pathlib import Path

import bpy
import numpy as np
import pytest
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.landmarks.skeleton import landmarks_of
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.tracking.live import CameraSource, LiveFrame
from livehand.backend.tracking.takes import FrameHands, put_together
from livehand.backend.tracking.tracked_hand import TrackedHand
from livehand.livehand_blender.motion import live as live_hands
from livehand.livehand_blender.motion.live import LiveSession, LiveSetup
from livehand.livehand_blender.rig.build import add_hand
from PIL import Image

PICTURES = Path(__file__).parents[1] / "tracking" / "pictures"
FRAMES = 12
PATIENCE_S = 90.0


@pytest.fixture(scope="module")
def waved(tmp_path_factory):
    """A right hand that moves to the right by 4 px a frame, 10 frames a second."""
    return write_film(tmp_path_factory.mktemp("live") / "wave.mp4", 10)


@pytest.fixture(scope="module")
def slow_film(tmp_path_factory):
    """The same, three seconds a frame: it plays until it is ended."""
    return write_film(tmp_path_factory.mktemp("live") / "slow.mp4", Fraction(1, 3))


def write_film(path, fps):
    av = pytest.importorskip("av", reason="PyAV (the extra video) is not installed")
    picture = np.asarray(Image.open(PICTURES / "palm.jpg").convert("RGB"))[::3, 160:1120:3]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(fps))
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        for index in range(FRAMES):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(np.roll(picture, 4 * index, 1)), format="rgb24")
            frame.pts, frame.time_base = index, 1 / Fraction(fps)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


@pytest.fixture(autouse=True)
def _session(tracker_networks):
    yield
    LiveSession.stop()


@pytest.fixture
def right_hand():
    return add_hand(bpy.context, load_default_hand())


def is_alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def start(path, **more):
    return LiveSession.start(LiveSetup(CameraSource(str(path), True), **more))


def step_until_found(session, count=1):
    """The newest frames with a hand, each after its step."""
    found, until = [], time.monotonic() + PATIENCE_S
    while len(found) < count and not session.has_ended and time.monotonic() < until:
        frame = session.step(bpy.context)
        if frame is not None and frame.hands:
            found.append(frame)
        time.sleep(0.002)
    return found


def nothing_is_left(pid):
    return (
        LiveSession.running is None
        and not is_alive(pid)
        and not bpy.data.images
        and not any(len(lens.background_images) for lens in bpy.data.cameras)
    )


@pytest.mark.slow
def test_the_hand_follows_without_keys_and_what_is_recorded_is_keyed_once(waved, right_hand):
    from bpy_extras.object_utils import world_to_camera_view

    scene = bpy.context.scene
    scene.frame_set(5)
    session = start(waved)
    session.record(scene)
    pid = session.pid
    across, seen = [], []
    while frames := step_until_found(session):
        bpy.context.view_layer.update()
        wrist = right_hand.matrix_world @ right_hand.pose.bones["wrist.R"].head
        across.append(world_to_camera_view(scene, scene.camera, wrist).x * 320)
        seen.append(frames[0].hands[0].px[0, 0])
    assert len(across) >= 2
    np.testing.assert_allclose(across, seen, atol=12)
    assert right_hand.animation_data is None or right_hand.animation_data.action is None
    image = bpy.data.images["LiveHand Live"]
    assert tuple(image.size) == (320, 240)
    count = session.key(bpy.context).frames
    assert not session.is_recording
    first, last = right_hand.animation_data.action.frame_range
    assert first == 5
    assert last - first + 1 >= count > 1  # a machine that is busy leaves gaps
    LiveSession.stop()
    assert nothing_is_left(pid)


@pytest.mark.slow
def test_a_killed_child_is_one_error_and_what_was_recorded_is_keyed(slow_film, right_hand):
    session = start(slow_film)
    session.record(bpy.context.scene)
    assert step_until_found(session)
    pid = session.pid
    os.kill(pid, signal.SIGKILL)
    with pytest.raises(LiveHandError, match="must go on, it ended"):
        step_until_found(session, FRAMES)
    assert session.key(bpy.context).frames >= 1
    LiveSession.stop()
    assert nothing_is_left(pid)


@pytest.mark.slow
def test_loading_a_file_ends_it(waved, right_hand):
    session = start(waved)
    assert step_until_found(session)
    pid = session.pid
    bpy.ops.wm.read_homefile(use_empty=True)
    assert nothing_is_left(pid)


def test_unregistering_ends_it(waved):
    pid = start(waved).pid
    live_hands.stop_watching()
    live_hands.watch_files()
    assert nothing_is_left(pid)


def test_a_second_session_ends_the_first(waved):
    first = start(waved).pid
    second = start(waved).pid
    assert not is_alive(first)
    assert is_alive(second)


class _FakeTracker:
    """Plays frames that were made, one a step."""

    pid, has_ended = 0, False

    def __init__(self, frames):
        self._frames = list(frames)
        self._kept = [FrameHands(frame.time_s, frame.size_px, frame.hands) for frame in frames]

    def newest(self):
        return self._frames.pop(0) if self._frames else None

    def record(self):
        pass

    def recorded(self):
        return put_together(self._kept)

    def close(self):
        pass


def seen_frames(count, mirror):
    """A right hand that closes before the camera; its landmarks in space multiplied by a mirror [3]."""
    axes, model, facing = FingerAxes.of_default_hand(), load_default_hand(), np.array([1.2092, 1.2092, 1.2092])
    picture = np.zeros((8, 8, 3), np.uint8)
    for index in range(count):
        theta = theta_of((0.2 + 0.6 * index / count) * GESTURES["fist"].angles_deg(), axes, facing)
        points = landmarks_of(model, HandPose(theta, np.zeros(10), np.zeros(3)))
        points += np.array([0, 0, 0.5]) - points.mean(0)
        px = points[:, :2] / points[:, 2:] * 1152 + [640, 360]
        world = (points - points.mean(0)) * mirror
        hand = TrackedHand(0, px, world, 1.0, 0.99)
        yield LiveFrame(index, index / 30, 0.0, (1280, 720), (hand,), picture)


@pytest.mark.parametrize(("mirror", "words"), [((1, 1, 1), ""), ((1, 1, -1), "bent backwards"), ((9, 9, 9), "9 times")])
def test_what_speaks_against_a_hand_is_told_while_it_follows(right_hand, monkeypatch, mirror, words):
    frames = list(seen_frames(45, np.array(mirror, float)))
    monkeypatch.setattr(live_hands, "LiveTracker", lambda source: _FakeTracker(frames))
    session = start("camera")
    while session.step(bpy.context) is not None:
        pass
    if not words:
        assert session.doubts == ()
        assert session.key(bpy.context).doubts == ()
        return
    assert session.doubts[0].startswith("Check the right hand: ")
    assert words in " ".join(session.doubts)
    if words == "bent backwards":
        assert words in session.key(bpy.context).doubts[0]


def test_a_lost_camera(tmp_path, right_hand):
    (tmp_path / "cut.mp4").write_bytes(b"\0" * 100)
    session = start(tmp_path / "cut.mp4")
    with pytest.raises(LiveHandError, match="must be a video"):
        step_until_found(session)


def test_a_recording_without_frames_changes_nothing(waved, right_hand):
    session = start(waved)
    session.record(bpy.context.scene)
    with pytest.raises(LiveHandError, match="must have frames, got none"):
        session.key(bpy.context)
    assert right_hand.animation_data is None or right_hand.animation_data.action is None


def test_without_a_window_the_operator_says_so(waved):
    if bpy.context.window is None:
        with pytest.raises(RuntimeError, match="need Blender's window"):
            bpy.ops.livehand.live(kind="FILE", filepath=str(waved))
    assert LiveSession.running is None
    assert not bpy.ops.livehand.live_record.poll()
    assert not bpy.ops.livehand.live_stop.poll()
