"""What a render returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .depth_profile import DepthProfile


@dataclass(frozen=True)
class Frame:
    """A rendered frame, top row first; its arrays may be read-only.

    Attributes:
        rgb: [H, W, 3] float32, scene-linear Rec.709, premultiplied by alpha.
        alpha: [H, W] float32 in [0, 1].
        depth: [H, W] float32 m along the optical axis; `DEPTH_BACKGROUND` where there is no hand.
        profile: opacity along the rays, for `composition`; None: an opaque surface at `depth`.
        is_lit: whether its colours are light of the scene, of any brightness; else those of a picture.
    """

    rgb: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray
    profile: DepthProfile | None = None
    is_lit: bool = False


DEPTH_BACKGROUND = 1e10  # Cycles' own value


def empty_frame(size_px: tuple[int, int]) -> Frame:
    """Make a frame without a hand."""
    width, height = size_px
    depth = np.full((height, width), DEPTH_BACKGROUND, np.float32)
    return Frame(np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.float32), depth)
