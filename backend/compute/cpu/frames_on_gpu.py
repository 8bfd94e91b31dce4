"""The backend of rendering on an NVIDIA GPU: whole frames by Warp, and torch on the CPU, so that any torch will do.

What cannot be rendered at once, numba renders stage by stage on the CPU, which takes no longer than torch on a GPU.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Generic, TypeVar

from ..whole_frames import BakedFrameRenderer, BakedModel, LitFrameRenderer, LitModel
from .backend import NumbaBackend

LOGGER = logging.getLogger(__name__)
Shot, Found = TypeVar("Shot"), TypeVar("Found")


class FramesOnGpu(NumbaBackend):
    """Renders whole frames on a device of Warp's, and stages on the CPU.

    Attributes:
        device: Warp's name of it.
    """

    renders_whole_frames = True

    def __init__(self, device: str) -> None:
        self.device = device

    def lit_frames(self, model: LitModel) -> LitFrameRenderer:
        """Return what renders whole lit frames of a model, until the GPU fails."""
        from ..gpu.lit_frame import lit_frames

        return UntilFailure(lit_frames(model, self.device).render)

    def baked_frames(self, model: BakedModel) -> BakedFrameRenderer:
        """Return what renders whole frames of a model in its capture's light, until the GPU fails."""
        from ..gpu.baked_frame import baked_frames

        return UntilFailure(baked_frames(model, self.device).render)


class UntilFailure(Generic[Shot, Found]):
    """Renders frames as long as Warp does; whatever is broken in it or in the driver, stages can render the others."""

    def __init__(self, render: Callable[[Shot], Found | None]) -> None:
        self._render, self._has_failed = render, False

    def render(self, shot: Shot) -> Found | None:
        """Render a frame; None: as what is given says, or the GPU has failed once."""
        if self._has_failed:
            return None
        try:
            return self._render(shot)
        except RuntimeError as error:
            self._has_failed = True
            LOGGER.warning("the GPU failed (%s); rendering continues on the CPU", error)
            return None
