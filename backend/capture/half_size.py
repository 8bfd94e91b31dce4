"""A capture seen at half its size: a quarter of the pixels, for the first and longest part of a training."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..records.camera import Camera
from .capture import Capture, CaptureView


@dataclass(frozen=True)
class HalfSizeCapture(Capture):
    """Its views have half the size; its images are the means of 2 x 2 pixels, and an odd last row or column is lost.

    Attributes:
        full: the capture at its own size.
        whole: its view of every file.
    """

    full: Capture = field(kw_only=True)
    whole: dict[str, CaptureView] = field(kw_only=True)

    def read_linear(self, view: CaptureView) -> np.ndarray:
        """Read as `Capture.read_linear` does."""
        return _halved(self.full.read_linear(self.whole[view.file]))

    def read_image(self, view: CaptureView) -> np.ndarray:
        """Read as `Capture.read_image` does."""
        return _halved(self.full.read_image(self.whole[view.file]))

    def read_pixels(self, view: CaptureView) -> np.ndarray:
        """Read as `Capture.read_pixels` does."""
        whole = self.full.read_pixels(self.whole[view.file]).astype(np.float32) / 255
        whole[..., :3] *= whole[..., 3:]
        small = _halved(whole)
        small[..., :3] /= np.maximum(small[..., 3:], 1e-6)
        return (small * 255).round().astype(np.uint8)


def half_size(capture: Capture) -> Capture:
    """Reduce the capture to half its size."""
    views = tuple(replace(view, camera=_halved_camera(view.camera)) for view in capture.views)
    provenance = {**capture.provenance, "half_size": True}
    whole = {view.file: view for view in capture.views}
    known = (capture.folder, capture.hand_sha256, provenance, capture.poses, views, capture.lights, capture.surface)
    return HalfSizeCapture(*known, full=capture, whole=whole)


def at_own_size(capture: Capture) -> Capture:
    """Return the capture whose cameras are those of its files, though it is seen at half its size."""
    return capture.full if isinstance(capture, HalfSizeCapture) else capture


def _halved_camera(camera: Camera) -> Camera:
    width, height = camera.size_px
    return replace(camera, K=np.diag([0.5, 0.5, 1.0]) @ camera.K, size_px=(width // 2, height // 2))


def _halved(pixels: np.ndarray) -> np.ndarray:
    """Average [H, W, C] over 2 x 2: [H // 2, W // 2, C]."""
    height, width = (side // 2 for side in pixels.shape[:2])
    return pixels[: 2 * height, : 2 * width].reshape(height, 2, width, 2, -1).mean((1, 3))
