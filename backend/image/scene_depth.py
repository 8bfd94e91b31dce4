"""The depth of triangles at every pixel, by which a view's hands are hidden."""

from __future__ import annotations

import numpy as np
import torch

from ..field.rays import camera_tensors, project
from ..geometry.rasterise import rasterise
from ..records.camera import Camera
from ..records.frame import DEPTH_BACKGROUND


def scene_depth(triangles: np.ndarray, camera: Camera) -> np.ndarray:
    """Rasterise the depth [H, W], m along the optical axis; `DEPTH_BACKGROUND` where there is nothing.

    Args:
        triangles: [T, 3, 3] in the world, m, all before the camera.
        camera: of the image.
    """
    width, height = camera.size_px
    nearest = torch.full((height * width,), DEPTH_BACKGROUND)
    if len(triangles):
        view = camera_tensors(camera, "cpu")
        corners = torch.as_tensor(triangles.reshape(-1, 3), dtype=torch.float32)
        faces = torch.arange(len(corners)).reshape(-1, 3)
        hits = rasterise(*project(view, corners), faces, view.size_px, view.is_orthographic)
        nearest.scatter_reduce_(0, hits.pixel.long(), hits.depth.float(), "amin")
    return nearest.reshape(height, width).numpy()
