"""The numba backend: the stages of a frame on the CPU, by compiled kernels."""

from __future__ import annotations

from .field import FieldKernels
from .gradients import ShadeKernels
from .image import ImageKernels
from .light import LightKernels
from .networks import NetworkKernels
from .rays import RayKernels
from .surface import SurfaceKernels
from .threads import threads_of_frame


class NumbaBackend(SurfaceKernels, RayKernels, FieldKernels, ShadeKernels, LightKernels, NetworkKernels, ImageKernels):
    """Has the reference's values on the CPU; it takes tensors that lie there only."""

    frames_at_once = 2
    threads_of_frame = staticmethod(threads_of_frame)
