"""The interface for programs: load a person, pose the hand, light it, render it to numpy. Stable from 0.3 on.

    from livehand import api

    person = api.load_person("light")
    frame = person.render(api.named_pose("Fist"), light=api.studio_light())
    picture = api.srgb_pixels(frame)  # [H, W, 4] uint8

Axes, units and colour are those of docs/dev/conventions.md: metres, radians, Z up, scene-linear premultiplied colours.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from .backend.avatars.avatar import Avatar
from .backend.avatars.file import load_avatar
from .backend.avatars.library import avatar_path
from .backend.avatars.metadata import watermark_of
from .backend.contact.grasp import Grasp, Grasper, GraspOptions
from .backend.contact.placed_solids import PlacedSolid
from .backend.geometry.framing import fitting_camera
from .backend.hand.gestures import FingerAxes, theta_of
from .backend.hand.lbs import posed_vertices
from .backend.hand.model import MIRROR_AXIS_ANGLE, HandModel, upright
from .backend.hand.model_file import DEFAULT_HAND, load_hand_model
from .backend.hand.poses import POSES
from .backend.image.decode import srgb_pixels
from .backend.image.watermark.embedding import watermarked
from .backend.motion.files.import_options import ImportOptions, motion_and_warning, with_options
from .backend.motion.files.open_files import open_motion_file
from .backend.motion.motion import HandMotion
from .backend.records.camera import Camera, look_at
from .backend.records.errors import LiveHandError
from .backend.records.frame import Frame
from .backend.records.light import Lamp, Light, Sky, rotation_facing
from .backend.records.shot import HandPose, Shot
from .backend.records.side import Side
from .backend.render.renderer import Renderer
from .backend.render.studio_light import studio_light

__all__ = [
    "Camera",
    "Frame",
    "Grasp",
    "GraspOptions",
    "HandMotion",
    "HandPose",
    "Lamp",
    "Light",
    "LiveHandError",
    "Person",
    "Sky",
    "load_motion",
    "load_person",
    "look_at",
    "named_pose",
    "rotation_facing",
    "srgb_pixels",
    "studio_light",
]

_FRONT = (0.0, -1.0, 0.0)
_SIZE_PX = (512, 512)
_FILL = 0.92  # share of the image that the hand fills


@dataclass(frozen=True)
class Person:
    """An avatar on its hand model. The first render takes seconds more than those that follow.

    Attributes:
        avatar: the appearance.
        hand: its hand model, of either side.
        device: "auto", "cpu", "cuda" or "mps".
    """

    avatar: Avatar
    hand: HandModel
    device: str = "auto"

    def vertices(self, pose: HandPose) -> np.ndarray:
        """Pose the hand's mesh: [V, 3] m in the world."""
        return posed_vertices(self.hand, pose)

    def camera(self, pose: HandPose, size_px: tuple[int, int] = _SIZE_PX) -> Camera:
        """Make a camera before the hand (at -Y of it) that frames a pose; size_px is (width, height)."""
        shown = self.vertices(pose)[self.hand.framed_vertices]
        return fitting_camera(shown, _FRONT, size_px, _FILL)

    def render(
        self,
        pose: HandPose,
        camera: Camera | None = None,
        light: Light | None = None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> Frame:
        """Render a pose; frames of a marked avatar have its watermark.

        Args:
            pose: of either hand.
            camera: None: one that frames the pose.
            light: None: that of the avatar's capture.
            should_stop: queried during the render.

        Raises:
            LiveHandError: the avatar belongs to another hand model, or the device is not available.
            RenderStopped: `should_stop` returned True.
        """
        shot = Shot(pose, self.vertices(pose), camera or self.camera(pose), light)
        frame, payload = self._renderer.render(shot, should_stop), watermark_of(self.avatar.provenance)
        return frame if payload is None else replace(frame, rgb=watermarked(frame.rgb, frame.alpha, payload))

    def grasp(
        self, pose: HandPose, vertices: np.ndarray, faces: np.ndarray, options: GraspOptions | None = None
    ) -> Grasp:
        """Close a hand on a mesh of vertices [N, 3] m, world, and triangles [F, 3]; the result has the new pose.

        Raises:
            LiveHandError: the mesh has no faces, the palm is inside it, or no finger reaches it.
        """
        thing = PlacedSolid.of(np.asarray(vertices), np.asarray(faces))
        return Grasper(self.hand, pose.beta).grasp(pose, [thing], options or GraspOptions())

    @cached_property
    def _renderer(self) -> Renderer:
        return Renderer(self.avatar, self.hand, self.device)


def load_person(name: str = "light", hand: Path | str | None = None, device: str = "auto") -> Person:
    """Load a person: "light", "middle" or "deep", who ship with LiveHand, or an avatar's file.

    Args:
        name: of the person, or the path of an avatar.
        hand: the file of the hand model; None: the built-in one.
        device: "auto", "cpu", "cuda" or "mps".

    Raises:
        LiveHandError: a file is missing or damaged.
    """
    return Person(load_avatar(avatar_path(name)), load_hand_model(hand or DEFAULT_HAND), device)


def named_pose(name: str, side: Side = "right", wrist: np.ndarray | None = None) -> HandPose:
    """Return a pose of the pose library, fingers up, the back of the hand to the front (-Y).

    Args:
        name: as Blender's asset browser has it, such as "Fist".
        side: which hand.
        wrist: [3] axis-angle, rad, by which the upright hand is turned in the world; None: not.

    Raises:
        LiveHandError: there is no such pose.
    """
    found = POSES.get(name)
    if found is None:
        raise LiveHandError(f"a pose must be one of {', '.join(sorted(POSES))}, got {name!r}")
    return _upright(theta_of(found.gesture.angles_deg(), FingerAxes.of_default_hand()), side, wrist)


def load_motion(path: Path | str, side: Side | None = None, mano: Path | None = None) -> HandMotion:
    """Read a file of poses or landmarks, in the file's own axes; `motion.pose(index)` is one frame's pose.

    What speaks against the motion is a `UserWarning`.

    Args:
        path: any that *Import Motion* reads, but for rigs.
        side: which of its hands; None: the right one, or the only one.
        mano: MANO's file, where poses count from its mean.

    Raises:
        LiveHandError: it cannot be read, or MANO's file is needed.
    """
    options = ImportOptions({"side": side} if side else {}, mano)
    file = with_options(open_motion_file(Path(path)), options)
    motion, doubt = motion_and_warning(file, options, load_hand_model(DEFAULT_HAND), None)
    if doubt:
        warnings.warn(f"{path}: check the motion: {doubt}", stacklevel=2)
    return motion


def _upright(theta: np.ndarray, side: Side, wrist: np.ndarray | None) -> HandPose:
    from .backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle

    turned = axis_angle_to_matrix(np.zeros(3) if wrist is None else wrist) @ upright(side)
    own = theta if side == "right" else theta * MIRROR_AXIS_ANGLE
    own[0] = matrix_to_axis_angle(turned)
    return HandPose(own, np.zeros(10), np.zeros(3), side)
