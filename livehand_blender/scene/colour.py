"""Converts frames to the scene's working space, and colours of the scene from it.

A backend frame is linear Rec.709, premultiplied by alpha. A Blender 5 file may have another working space (Rec.2020,
ACEScg); the conversion is a 3x3 matrix, so it applies to premultiplied colour directly.
"""

from __future__ import annotations

from dataclasses import replace

import mathutils
import numpy as np

from ...backend.records.frame import Frame


def in_working_space(frame: Frame) -> Frame:
    """Convert the frame to the scene's working space."""
    matrix = rec709_to_working_space()
    return frame if np.array_equal(matrix, np.eye(3)) else replace(frame, rgb=frame.rgb @ matrix.T)


def rec709_to_working_space() -> np.ndarray:
    """Compute [3, 3], exactly the identity if the scene works in Rec.709, as all files before Blender 5 do."""
    columns = [mathutils.Color(axis).from_rec709_linear_to_scene_linear() for axis in np.eye(3)]
    matrix = np.array(columns, np.float32).T
    identity = np.eye(3, dtype=np.float32)
    # Blender converts through XYZ in single precision: the identity comes back 5e-6 off.
    return identity if np.abs(matrix - identity).max() <= 5e-5 else matrix


def in_rec709(rgb: np.ndarray) -> np.ndarray:
    """Convert colours [..., 3] of the scene's working space to linear Rec.709."""
    matrix = rec709_to_working_space()
    return rgb if np.array_equal(matrix, np.eye(3)) else rgb @ np.linalg.inv(matrix).T
