"""The Warp backend: the stages of a frame that have kernels; torch computes the others."""

from __future__ import annotations

from .image_stages import ImageStages
from .light_stages import LightStages
from .ray_stages import RayStages
from .surface_stages import SurfaceStages


class WarpBackend(RayStages, LightStages, ImageStages, SurfaceStages):
    """Has the reference's values, on tensors of an NVIDIA GPU or of the CPU, which only tests give it."""
