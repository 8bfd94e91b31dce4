"""Hands that follow a camera: posed without keys while it runs, keyed once with what was recorded.

The tracker is a process of its own. What Blender holds of a session are names, so that it outlives undo steps; it ends
with the file, with the extension and with Blender.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, NamedTuple

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ...backend.motion.landmarks.live_gate import LiveGate
from ...backend.motion.landmarks.online_fit import OnlineFit
from ...backend.motion.landmarks.take_file import take_doubts, unmirrored, unmirrored_hands
from ...backend.motion.landmarks.take_fit import FilmCamera, FilmedHand, fit_take
from ...backend.motion.motion import motion_from_poses
from ...backend.motion.spaces import rest_wrists, transformed
from ...backend.records.errors import LiveHandError
from ...backend.records.side import Side
from ...backend.tracking.live import CameraSource, LiveFrame, LiveTracker
from ...backend.tracking.sighted_take import filmed_take
from ...backend.tracking.takes import by_side
from ..rig.hand import RiggedHand
from ..rig.pose import write_theta, write_transl
from ..rig.sliders import read_beta
from ..scene.handlers import add_handlers, remove_handlers
from .film_scene import camera_with_lens, hand_of_side
from .filmed import key_take
from .frames import frame_rate
from .keying import Placement, to_armature

_IMAGE = "LiveHand Live"
_FILM_MM = 36.0


@dataclass(frozen=True)
class LiveSetup:
    """What is watched.

    Attributes:
        source: the camera.
        focal_mm: for a film 36 mm wide; 0: guessed.
        is_picture_mirrored: the camera mirrors its picture.
    """

    source: CameraSource
    focal_mm: float = 0.0
    is_picture_mirrored: bool = False


class KeyedRecording(NamedTuple):
    """What a recording became: how many frames were keyed, and what speaks against them, hand by hand."""

    frames: int
    doubts: tuple[str, ...]


class LiveSession:
    """A camera and the hands of a scene that follow it, from `start` to `stop`; there is one at a time.

    Attributes:
        running: the session, if there is one.
        is_recording: whether what is seen will be keyed.
    """

    running: ClassVar[LiveSession | None] = None

    def __init__(self, setup: LiveSetup):
        self.is_recording = False
        self._setup = setup
        self._film: FilmCamera | None = None
        self._followers: dict[str, _Follower] = {}
        self._labels: dict[int, tuple[float, int]] = {}
        self._start_frame = 1
        self._tracker = LiveTracker(setup.source)

    @classmethod
    def start(cls, setup: LiveSetup) -> LiveSession:
        """Start to watch a camera; a session that runs is stopped.

        Raises:
            LiveHandError: the tracker's networks are not there.
        """
        cls.stop()
        cls.running = cls(setup)
        return cls.running

    @classmethod
    def stop(cls) -> None:
        """End the session, its process and its picture; what is recorded and not keyed is lost."""
        session, cls.running = cls.running, None
        if session is not None:
            session._tracker.close()
            _remove_picture()

    @property
    def pid(self) -> int:
        """Of the tracker's process."""
        return self._tracker.pid

    @property
    def has_ended(self) -> bool:
        """Whether the file that plays as a camera is over."""
        return self._tracker.has_ended

    def step(self, context: bpy.types.Context) -> LiveFrame | None:
        """Pose the hands as the newest frame shows them, and show its picture; None if there is no new one.

        Raises:
            LiveHandError: the camera was lost, or the tracker's process has died.
        """
        frame = self._tracker.newest()
        if frame is None:
            return None
        camera = self._camera(context, frame.size_px)
        placement = Placement("opencv", camera=np.array(camera.matrix_world.normalized()))
        _show(camera, frame.picture[:, ::-1] if self._setup.is_picture_mirrored else frame.picture)
        for side, filmed in self._filmed(frame):
            hand = hand_of_side(context, side)
            if hand is not None:
                self._pose(hand, filmed, frame.time_s, placement)
        return frame

    @property
    def doubts(self) -> tuple[str, ...]:
        """What speaks against the hands of the last seconds; empty: nothing."""
        return tuple(
            f"Check the {follower.side} hand: {doubt}"
            for follower in self._followers.values()
            for doubt in follower.gate.doubts
        )

    def record(self, scene: bpy.types.Scene) -> None:
        """Keep what is seen from now on, to be keyed from the scene's frame on."""
        self._start_frame = scene.frame_current
        self._tracker.record()
        self.is_recording = True

    def key(self, context: bpy.types.Context) -> KeyedRecording:
        """End the recording, fit all of it at once and key it.

        Raises:
            LiveHandError: no hand was seen that the scene has. Nothing is changed then.
        """
        self.is_recording = False
        found, film = self._tracker.recorded(), self._film
        if found is None or film is None:
            raise LiveHandError("a recording must have frames, got none; record again once the hand follows")
        scene = context.scene
        take = replace(filmed_take(found, frame_rate(scene), None, Path(self._setup.source.name)), camera=film)
        take = unmirrored(take) if self._setup.is_picture_mirrored else take
        fits = []
        for side, filmed in take.hands.items():
            if (hand := hand_of_side(context, side)) is not None:
                beta = read_beta(hand.armature)
                fits.append((hand, fit_take(filmed, take.times, film, hand.model, side, take.fps, beta)))
        if not fits:
            raise LiveHandError(
                f"the scene must have a hand that the camera shows ({', '.join(take.hands)}), got none; add one, or "
                "turn Mirrored Picture on"
            )
        camera = np.array(camera_with_lens(scene, film).matrix_world.normalized())
        placement = Placement("opencv", self._start_frame, camera=camera)
        frames = sum(key_take(scene, hand, fit, placement) for hand, fit in fits)
        found = [(hand.side, take_doubts(fit, hand.model)) for hand, fit in fits]
        return KeyedRecording(frames, tuple(f"Check the {side} hand: {doubt}" for side, doubt in found if doubt))

    def _camera(self, context: bpy.types.Context, size_px: tuple[int, int]) -> bpy.types.Object:
        """Return the scene's camera, which has got the film's lens."""
        camera = context.scene.camera
        if camera is None or self._film is None or self._film.size_px != size_px:
            focal_mm = self._setup.focal_mm
            guessed = FilmCamera.guessed(size_px)
            self._film = FilmCamera(size_px, focal_mm / _FILM_MM * size_px[0]) if focal_mm else guessed
            self._followers.clear()
            camera = camera_with_lens(context.scene, self._film)
            context.view_layer.update()  # a new one has no place yet
        return camera

    def _filmed(self, frame: LiveFrame) -> Iterator[tuple[Side, FilmedHand]]:
        """Yield the hands by side; a hand has the side of its mean label."""
        tracks = []
        for hand in frame.hands:
            total, count = self._labels.get(hand.track, (0.0, 0))
            self._labels[hand.track] = total + hand.right, count + 1
            tracks.append([(0, replace(hand, right=(total + hand.right) / (count + 1)))])
        film = self._film
        assert film is not None
        hands: dict[Side, FilmedHand] = {}
        for side, one in by_side(tracks).items():
            hands[side] = FilmedHand(one.frames, one.px, one.world)
        if self._setup.is_picture_mirrored:
            hands = unmirrored_hands(hands, film)
        yield from hands.items()

    def _pose(self, hand: RiggedHand, filmed: FilmedHand, time_s: float, placement: Placement) -> None:
        follower = self._followers.get(hand.armature.name)
        if follower is None:
            assert self._film is not None
            follower = _Follower.of(hand, self._film)
            self._followers[hand.armature.name] = follower
        try:
            found = follower.fit.follow(time_s, filmed.px[0], filmed.world[0])
        except LiveHandError as error:  # landmarks of no hand's size
            follower.gate.refused(time_s, str(error))
            return
        follower.gate.saw(time_s, filmed.world[0], found and found.pose)
        if found is None:
            return
        motion = motion_from_poses([found.pose])
        motion = transformed(motion, to_armature(hand.armature, placement), follower.rest_wrist_m)
        write_theta(hand, motion.theta[0])
        write_transl(hand, motion.transl[0])
        hand.armature.update_tag()


@dataclass(frozen=True)
class _Follower:
    """The fit of a hand in its own shape, where its wrist rests [3] m, and what speaks against it."""

    fit: OnlineFit
    rest_wrist_m: np.ndarray
    gate: LiveGate
    side: Side

    @classmethod
    def of(cls, hand: RiggedHand, film: FilmCamera) -> _Follower:
        model, beta = hand.model, read_beta(hand.armature)
        fit, gate = OnlineFit(film, model, hand.side, beta), LiveGate(model, hand.side)
        return cls(fit, rest_wrists(model, beta), gate, hand.side)


def _show(camera: bpy.types.Object, picture: np.ndarray) -> None:
    """Show the picture behind the scene, as the camera's background."""
    height, width = picture.shape[:2]
    image = bpy.data.images.get(_IMAGE)
    if image is not None and tuple(image.size) != (width, height):
        _remove_picture()
        image = None
    if image is None:
        image = bpy.data.images.new(_IMAGE, width, height)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = picture[::-1] / np.float32(255)
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    backgrounds = camera.data.background_images
    if not any(one.source == "IMAGE" and one.image == image for one in backgrounds):
        background = backgrounds.new()
        background.source, background.image, background.alpha = "IMAGE", image, 1.0
        background.frame_method = "FIT"
        camera.data.show_background_images = True


def _remove_picture() -> None:
    image = bpy.data.images.get(_IMAGE)
    if image is None:
        return
    for lens in bpy.data.cameras:
        for background in [one for one in lens.background_images if one.image == image]:
            lens.background_images.remove(background)
    bpy.data.images.remove(image)


@persistent
def _stop(*_) -> None:
    """Stop before another file is opened."""
    LiveSession.stop()


_WATCHED = (("load_pre", _stop),)


def watch_files() -> None:
    """End the session whenever another file is opened."""
    add_handlers(_WATCHED)


def stop_watching() -> None:
    """End the session, and undo `watch_files`."""
    LiveSession.stop()
    remove_handlers(_WATCHED)
