"""The Warp backend: the stages of a frame that have kernels; torch computes the others.

It is checked before it is used. Errors name what must be changed, because all that they cost is speed: torch renders
where Warp cannot.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ...records.errors import LiveHandError
from ..whole_frames import BakedFrameRenderer, BakedModel, LitFrameRenderer, LitModel
from .ahead import use_shipped
from .baked_frame import baked_frames
from .field_stages import FieldStages
from .image_stages import ImageStages
from .kernels.raster import prepare_view
from .light_stages import RadianceStages
from .lit_frame import lit_frames
from .ray_stages import RayStages
from .surface_stages import DetailStages


class WarpBackend(RayStages, FieldStages, RadianceStages, ImageStages, DetailStages):
    """Has the reference's values, on tensors of an NVIDIA GPU or of the CPU, which only tests give it.

    Attributes:
        device: Warp's name of where it renders whole frames; None: it renders them stage by stage.
    """

    def __init__(self, device: str | None = None) -> None:
        self.device = device
        self.renders_whole_frames = device is not None

    def lit_frames(self, model: LitModel) -> LitFrameRenderer:
        """Return what renders whole lit frames of a model."""
        assert self.device is not None
        return lit_frames(model, self.device)

    def baked_frames(self, model: BakedModel) -> BakedFrameRenderer:
        """Return what renders whole frames of a model in its capture's light."""
        assert self.device is not None
        return baked_frames(model, self.device)


_OFF = 1e-6


def check_gpu() -> None:
    """Compute a camera's axes on the GPU.

    Raises:
        LiveHandError: the driver or the chip is too old, or the values are wrong.
    """
    if not wp.is_cuda_available():
        raise LiveHandError(driver_message(wp.get_cuda_toolkit_version(), wp.get_cuda_driver_version()))
    chip, oldest = wp.get_cuda_device().arch, min(wp.get_cuda_supported_archs())
    if chip < oldest:
        raise LiveHandError(f"the GPU must be of compute capability {oldest / 10} or later, got {chip / 10}")
    use_shipped()
    check_values("cuda:0")


def check_values(device: str) -> None:
    """Compute a camera's axes on a device of Warp's.

    Raises:
        LiveHandError: they are wrong.
    """
    # 2 px a unit of width, 4 px a unit of height, turned by a quarter about its axis, 3 m behind the origin.
    K = wp.array([[2.0, 0, 8], [0, 4, 6], [0, 0, 1]], dtype=wp.float32, device=device)
    world2cam = [[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]
    expected = np.array([[0.0, 0, -3], [0, 0.5, 0], [-0.25, 0, 0], [1.5, -4, 1]])
    view = wp.zeros(4, dtype=wp.vec3, device=device)
    wp.launch(prepare_view, 1, [K, wp.array(world2cam, dtype=wp.float32, device=device), view], device=device)
    found = view.numpy()
    if not np.allclose(found, expected, atol=_OFF):
        raise LiveHandError(f"a camera's axes must be {expected.tolist()}, got {found.tolist()} on {device}")


def driver_message(toolkit: tuple[int, int] | None, driver: tuple[int, int] | None) -> str:
    """Say which driver Warp lacks; of each the version of CUDA, None: none was found."""
    asked = "CUDA" if toolkit is None else f"CUDA {toolkit[0]}"
    found = "none" if driver is None else f"one for CUDA {driver[0]}.{driver[1]}"
    return f"the NVIDIA driver must support {asked}, got {found}; update the driver"
