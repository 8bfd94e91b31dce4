"""The shots of a filmed motion, in a world whose origin is the middle of the path: there the studio's light is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...hand.lbs import posed_vertices
from ...hand.model import HandModel
from ...motion.landmarks.take_fit import FilmCamera, TakeFit
from ...motion.motion import HandMotion
from ...motion.resampling import sampled_at
from ...motion.spaces import rest_wrists, to_blender, transformed
from ...records.camera import Camera
from ...records.shot import HandPose, Shot
from ...render.studio_light import studio_light


@dataclass(frozen=True)
class FilmedShots:
    """A fitted take before its camera.

    Attributes:
        motion: in Blender's world.
        camera: of the film.
        model: the hand, of the motion's side.
        fit: what the motion comes from.
    """

    motion: HandMotion
    camera: Camera
    model: HandModel
    fit: TakeFit

    @classmethod
    def of(cls, fit: TakeFit, film: FilmCamera, model: HandModel) -> FilmedShots:
        """Make the shots of a fit in its camera's axes."""
        model = model.for_side(fit.motion.side)
        wrists = rest_wrists(model, fit.motion.beta)
        to_world = to_blender("opencv")
        to_world[:3, 3] = -to_world[:3, :3] @ (wrists + fit.motion.transl).mean(0)
        motion = transformed(fit.motion, to_world, wrists)
        width, height = film.size_px
        K = np.array([[film.focal_px, 0, width / 2], [0, film.focal_px, height / 2], [0, 0, 1.0]])
        return cls(motion, Camera(K, to_world, film.size_px), model, fit)

    def index_at(self, time_s: float) -> int | None:
        """Find the motion's frame at a time of the film; None where the hand has no keys."""
        index = round((time_s - self.fit.start_s) * (self.fit.motion.fps or 30.0))
        return index if 0 <= index < len(self.motion) and self.fit.is_keyed[index] else None

    def pose(self, index: int | float) -> HandPose:
        """Return the pose of one frame, or one between two."""
        if index == int(index):
            return self.motion.pose(int(index))
        return sampled_at(self.motion, np.array([index])).pose(0)

    def shot(self, index: int | float, scale: float = 1.0) -> Shot:
        """Make the shot of a frame, or of an instant between two, at a share of the film's resolution."""
        pose = self.pose(index)
        camera = self.camera if scale == 1 else self.camera.scaled(scale)
        return Shot(pose, posed_vertices(self.model, pose), camera, studio_light())

    def arm_reach(self, shot: Shot) -> tuple[np.ndarray, float]:
        """Measure the direction from knuckle to wrist [3] in the world, and how far along it the hand is shown, m."""
        wrist, knuckle = self._wrist_and_knuckle(shot)
        along = (wrist - knuckle) / np.linalg.norm(wrist - knuckle)
        return along, min(float((shot.vertices @ along).max()), float(wrist @ along) + _BEHIND_M)

    def before_the_cut(self, shot: Shot) -> np.ndarray:
        """Return [H, W] 1 on the hand's side of the wrist's cut in the picture, 0 on the arm's, soft between them."""
        along, reach_m = self.arm_reach(shot)
        _, middle = self._wrist_and_knuckle(shot)
        cut = middle + along * (reach_m - middle @ along)
        (start, end), _ = shot.camera.project(np.stack([middle, cut]))
        length = max(float(np.linalg.norm(end - start)), 1.0)
        x, y = (end - start) / length
        width, height = shot.camera.size_px
        rows, columns = np.arange(height)[:, None] + 0.5, np.arange(width)[None] + 0.5
        beyond = ((columns - end[0]) * x + (rows - end[1]) * y) / (_SOFT * length)
        return np.clip(-beyond, 0, 1).astype(np.float32)

    def _wrist_and_knuckle(self, shot: Shot) -> np.ndarray:
        """Locate the wrist and the middle finger's knuckle [2, 3] m of the posed surface in the world."""
        return self.model.J_regressor[[0, _MIDDLE_KNUCKLE]] @ shot.vertices


_MIDDLE_KNUCKLE = 4
_BEHIND_M = 0.015  # from the wrist
_SOFT = 0.2  # of the distance from the knuckle to the cut
