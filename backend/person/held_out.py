"""How well a person shows pictures that were kept from the fits: as given, and where flow has aligned them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..capture.masks.mask import load_opencv
from ..capture.picture import linear_to_srgb, srgb_to_linear
from .flow import flow_between
from .light import PictureLight
from .model import PersonModel
from .picture import HAND, UNKNOWN, HandPicture

_CLIPPED = 0.98
_ALIGNED_ERODED_PX = 9


class HeldOutFigures(NamedTuple):
    """Means over pictures.

    Attributes:
        psnr_db: of sRGB-encoded colours on the hand, after the best gain of each channel.
        aligned_psnr_db: the same inside the outline, after flow.
        overlap: of outline and mask, intersection over union of what is known.
        pictures: how many there are.
    """

    psnr_db: float
    aligned_psnr_db: float
    overlap: float
    pictures: int


def held_out_figures(
    model: PersonModel, pictures: Sequence[HandPicture], lights: Mapping[int, PictureLight]
) -> HeldOutFigures | None:
    """Measure the pictures that are held out; None: there are none."""
    rows = [_row(model, picture, lights[picture.scene]) for picture in pictures if picture.is_held_out]
    rows = [row for row in rows if row is not None]
    if not rows:
        return None
    psnr, aligned, overlap = np.mean(rows, 0)
    return HeldOutFigures(float(psnr), float(aligned), float(overlap), len(rows))


def _row(model: PersonModel, picture: HandPicture, light: PictureLight) -> tuple[float, float, float] | None:
    cv2 = load_opencv()
    frame = model.rendered(picture.pose, picture.camera, light.light)
    shown, is_hand = picture.rgb.astype(np.float32) / 255, picture.labels == HAND
    is_ours, is_told = frame.alpha > 0.5, picture.labels != UNKNOWN
    both = is_hand & is_ours
    if not both.any():
        return None
    linear = frame.rgb / np.maximum(frame.alpha[..., None], 1e-3)
    even = both & (shown.max(-1) < _CLIPPED)
    gain = np.exp(np.median(np.log((srgb_to_linear(shown)[even] + 1e-3) / (linear[even] + 1e-3)), 0))
    ours = linear_to_srgb((linear * gain).clip(0, 1).astype(np.float32))
    overlap = both.sum() / ((is_ours & is_told) | is_hand).sum()
    flow = flow_between(_on_grey(shown, is_hand), _on_grey(ours, is_ours), finest_level=0)
    rows, columns = np.mgrid[: shown.shape[0], : shown.shape[1]].astype(np.float32)
    aligned = cv2.remap(ours, columns + flow.px[..., 0], rows + flow.px[..., 1], cv2.INTER_LINEAR)
    inner = cv2.erode(both.astype(np.uint8), np.ones((_ALIGNED_ERODED_PX, _ALIGNED_ERODED_PX))) > 0
    on_black = ours * is_ours[..., None]
    return _psnr(on_black, shown, is_hand), _psnr(aligned, shown, inner if inner.any() else both), float(overlap)


def _on_grey(encoded: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return np.where(mask, encoded.mean(-1), 0.1)


def _psnr(ours: np.ndarray, theirs: np.ndarray, where: np.ndarray) -> float:
    return float(-10 * np.log10(max(((ours - theirs)[where] ** 2).mean(), 1e-9)))
