"""Backend `Frame` -> the flat buffers Blender's render passes take: bottom row first, float32, scene-linear.

The frame is linear Rec.709, premultiplied by alpha. A Blender 5 file may work in another space (Rec.2020, ACEScg);
the change is a 3x3 matrix, so it holds for premultiplied colour as it is.
"""

from __future__ import annotations

import mathutils
import numpy as np

from ...backend.shot import Frame


def combined_buffer(frame: Frame) -> np.ndarray:
    """The Combined pass: RGBA, premultiplied, in the scene's working space; [H * W * 4]."""
    rgb = frame.rgb @ rec709_to_working_space().T
    rgba = np.concatenate([rgb, frame.alpha[..., None]], axis=-1)
    return _bottom_up(rgba)


def depth_buffer(frame: Frame) -> np.ndarray:
    """The Depth pass, m along the optical axis; [H * W]."""
    return _bottom_up(frame.depth)


def rec709_to_working_space() -> np.ndarray:
    """[3, 3], exactly the identity where the scene works in Rec.709, as all files before Blender 5 do."""
    columns = [mathutils.Color(axis).from_rec709_linear_to_scene_linear() for axis in np.eye(3)]
    matrix = np.array(columns, np.float32).T
    # Blender passes the probe through XYZ in single precision: the identity comes back 5e-6 off.
    return np.eye(3, dtype=np.float32) if np.allclose(matrix, np.eye(3), atol=5e-5) else matrix


def _bottom_up(image: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(image[::-1], np.float32).ravel()
