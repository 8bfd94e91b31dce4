"""The frames of a posed hand's bones, and whether a mesh is that of its pose."""

from __future__ import annotations

import numpy as np
import torch

from ..records.errors import LiveHandError
from ..records.shot import HandPose, Shot
from .lbs import SkinTensors, pose_hand, posed_vertices
from .model import MIRROR_POINT, HandModel

_MAX_OFF_POSE_M = 0.001  # root mean square over the vertices


def bone_frames(model: HandModel, pose: HandPose) -> np.ndarray:
    """Compute [16, 4, 4] from each joint's frame to the world, m; the other hand's are mirrored to the model's side.

    Their axes are the template's, turned by the joint's rotation in the world.
    """
    skin = SkinTensors.of(model.for_side(pose.side), dtype=torch.float64)
    posed = pose_hand(skin, *(torch.as_tensor(value, dtype=torch.float64) for value in _parameters(pose)))
    frames = posed.transforms.numpy().copy()
    frames[:, :3, 3] = posed.joints.numpy()
    if pose.side != model.side:
        frames[:, :3, :3] *= MIRROR_POINT
    return frames


def check_on_pose(shot: Shot, model: HandModel) -> None:
    """Raise LiveHandError if the shot's mesh is not that of its pose: bones would not be where its surface is."""
    off = shot.vertices - posed_vertices(model, shot.pose)
    rms_m = float(np.sqrt((off**2).sum(1).mean()))
    if rms_m > _MAX_OFF_POSE_M:
        raise LiveHandError(
            f"a method that looks at bones needs the mesh of their pose, got one {1000 * rms_m:.1f} mm off; "
            "remove shape keys, modifiers and sculpting, or render with another avatar"
        )


def _parameters(pose: HandPose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return pose.theta, pose.beta, pose.transl
