"""The numba backend: the stages of a frame on the CPU, by compiled kernels."""

from __future__ import annotations

from ..reference import ReferenceBackend
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


_SUBJECTS: tuple[tuple[type[ReferenceBackend], ...], ...] = (
    (RayKernels, FieldKernels),
    (LightKernels,),
    (SurfaceKernels,),
    (ImageKernels, NetworkKernels),
)
"""Together they have all kernels of a frame; in the order of the time that these take to compile."""


def share_of_backend(number: int, count: int) -> ReferenceBackend:
    """Make one of `count` backends that together use all kernels of a frame; the rest of each is the reference's."""
    bases = tuple(base for subject in _SUBJECTS[number::count] for base in subject)
    return type(f"Share{number}Of{count}", bases, {})()
