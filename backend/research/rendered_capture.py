"""Captures whose pictures are an avatar's own frames: made in seconds, of a person whose surface is then not given.

What is trained on one sees the pictures and the hand model's bare mesh. Pictures are means of 2 x 2 rendered pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from ..capture.capture import Capture, CaptureView, save_capture_index
from ..capture.plan import DISTANCE_M, CapturePlan, fibonacci_sphere
from ..capture.split import split_of
from ..evaluation.shot_renderer import ShotRenderer
from ..geometry.mesh_tables import area_weighted_normals
from ..hand.lbs import posed_vertices
from ..hand.model import HandModel
from ..image.decode import srgb_pixels
from ..records.camera import Camera, look_at
from ..records.frame import Frame
from ..records.shot import Shot
from ..system.files import replacing

_FINER = 2
_FACING = 0.4  # cosine of normal and direction
_STEEP = 0.9


class CloseUps(NamedTuple):
    """A plan of close-ups; every 11th pose and every 4th direction are held out.

    Attributes:
        poses: how many.
        directions: from which they are seen, over the whole sphere.
        field_m: width of a picture on the skin.
        size_px: of its sides.
        seed: of poses and of what is looked at.
        beta: [10] shape.
    """

    poses: int = 24
    directions: int = 12
    field_m: float = 0.09
    size_px: int = 96
    seed: int = 0
    beta: tuple[float, ...] = (0.0,) * 10

    def make(self, folder: Path, hand: HandModel, provenance: dict) -> Capture:
        """Plan a capture whose cameras look at a random part of the hand that faces them."""
        plan = CapturePlan(seed=self.seed, poses=self.poses)
        poses = tuple(replace(pose, beta=np.array(self.beta)) for pose in plan.make(folder, hand, {}).poses)
        rng, towards = np.random.default_rng(self.seed), fibonacci_sphere(self.directions)
        views = []
        for pose_index, pose in enumerate(poses):
            vertices = posed_vertices(hand, pose)
            normals = area_weighted_normals(vertices, hand.f)
            for index, direction in enumerate(towards):
                target = self._looked_at(vertices, normals, direction, _beyond_wrist(hand), rng)
                split = split_of(plan.is_held_out_pose(pose_index), index % 4 == 3)
                file = f"images/pose{pose_index:03d}_cam{index:02d}.png"
                views.append(CaptureView(file, self._camera(target, direction), index, pose_index, split))
        return Capture(folder, hand.sha256, {**provenance, "plan": self._asdict()}, poses, tuple(views))

    def _looked_at(
        self,
        vertices: np.ndarray,
        normals: np.ndarray,
        direction: np.ndarray,
        shown: np.ndarray,
        rng: np.random.Generator,
    ) -> np.ndarray:
        facing = shown[(normals[shown] @ direction) > _FACING]
        return vertices[rng.choice(facing if len(facing) else shown)]

    def _camera(self, target: np.ndarray, direction: np.ndarray) -> Camera:
        focal_px, middle_px = self.size_px * DISTANCE_M / self.field_m, self.size_px / 2
        K = np.array([[focal_px, 0, middle_px], [0, focal_px, middle_px], [0, 0, 1.0]])
        up = np.array([0, 0, 1.0]) if abs(direction[2]) < _STEEP else np.array([0, 1.0, 0])
        return Camera(K, look_at(target + DISTANCE_M * direction, target, up), (self.size_px, self.size_px))


def _beyond_wrist(hand: HandModel) -> np.ndarray:
    """List the vertices between wrist and fingertips."""
    wrist, knuckle = hand.joints[0], hand.joints[4]
    return np.flatnonzero((hand.v_template - wrist) @ (knuckle - wrist) > 0)


def render_capture(capture: Capture, renderer: ShotRenderer, say: Callable[[str], None] = lambda line: None) -> Capture:
    """Render the pictures that are not there yet in the avatar's own light, and last the index.

    Raises:
        LiveHandError: the renderer is of another hand, or the folder cannot be written.
    """
    for number, view in enumerate(capture.views):
        path = capture.folder / view.file
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            pixels = srgb_pixels(_halved(renderer.render(_shot(capture, view, renderer.hand))))
            with replacing(path) as partial:
                Image.fromarray(pixels).save(partial, format="PNG")
            say(f"{number + 1}/{len(capture.views)} {view.file}")
    save_capture_index(capture)
    return capture


def _shot(capture: Capture, view: CaptureView, hand: HandModel) -> Shot:
    """Make the shot of a view, with twice its pixels along each side."""
    camera, pose = view.camera, capture.poses[view.pose_index]
    K = np.diag([_FINER, _FINER, 1.0]) @ camera.K
    width, height = camera.size_px
    finer = Camera(K, camera.cam2world, (_FINER * width, _FINER * height))
    return Shot(pose, posed_vertices(hand, pose), finer)


def _halved(frame: Frame) -> Frame:
    """Average 2 x 2 pixels; depth is not kept."""
    height, width = frame.alpha.shape[0] // _FINER, frame.alpha.shape[1] // _FINER
    blocks = (height, _FINER, width, _FINER)
    rgb = frame.rgb.reshape(*blocks, 3).mean((1, 3))
    alpha = frame.alpha.reshape(blocks).mean((1, 3))
    return Frame(rgb, alpha, np.full(alpha.shape, 1e10, np.float32))
