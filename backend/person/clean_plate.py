"""What stands behind a hand that moves before a resting camera, and what it tells of each pixel.

A clean plate is a film's picture without what moves. A pixel that shows the hand and the ground behind it, at an edge
or because the hand moves while it is exposed, mixes both colours, and each may be in the shade: the mixture tells
which has the larger part (Smith and Blinn 1996, "Blue screen matting", with a ground that is known at each pixel).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from ..capture.masks.mask import load_opencv
from ..capture.picture import srgb_to_linear
from ..records.hand_picture import BACKGROUND, HAND, UNKNOWN
from ..tracking.turning_hand.window import Window, image_of

_LONGEST_PX = 1280  # of the pictures whose median is taken
_LEAST_SEEN = 3  # pictures
_COVERED = 255
_QUARTILES = (0.25, 0.75)  # of a pixel's values; the brighter one is out of the hand's shadow
_MOST_TINT, _DARK = 0.1, 24  # by how much more of one channel than of another is lost in a shadow; of 255
_SKIN_BLUR, _FAR_BLUR, _FAR_WEIGHT = 0.03, 0.2, 1e-3  # of the picture's longer side
_TOGETHER = 3e-3  # how much both colours are rather darkened alike; linear, squared
_MOST_UNEXPLAINED, _NOISE = 0.2, 0.01  # of a colour, and linear
_LEAST_APART = 0.02  # squared sine of the angle between the two colours
_DARKEST_SHADE, _BRIGHTEST_GROUND = 0.3, 1.25  # of the light without a shadow
_DARKEST_SKIN = 0.3  # of the skin around
_PURE = 0.8  # share of a pixel's light that comes from skin where nothing else is shown
_MIXED = 0.01  # how wide edges are, of the picture's longer side
_LEAST_RING_PX = 50


@dataclass(frozen=True)
class CleanPlate:
    """The ground of a film, or of a part of its picture.

    Attributes:
        rgb: uint8 [H, W, 3], sRGB.
        is_known: [H, W], where it was seen, alike but for shadows.
    """

    rgb: UInt8[np.ndarray, "H W 3"]
    is_known: Bool[np.ndarray, "H W"]

    def within(self, window: Window) -> CleanPlate:
        """Return the plate of a window's image."""
        known = image_of(np.repeat(self.is_known[..., None].astype(np.uint8) * 255, 3, -1), window)[..., 0]
        return CleanPlate(image_of(self.rgb, window), known > _COVERED // 2)


def small_enough(picture: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """Make a picture smaller whose longer side is over 1280 px."""
    share = _LONGEST_PX / max(picture.shape[:2])
    if share >= 1:
        return np.ascontiguousarray(picture)
    cv2 = load_opencv()
    return cv2.resize(np.ascontiguousarray(picture), None, fx=share, fy=share, interpolation=cv2.INTER_AREA)


def clean_plate(
    pictures: Sequence[UInt8[np.ndarray, "h w 3"]], covered: Sequence[Bool[np.ndarray, "_ _"]], size_px: tuple[int, int]
) -> CleanPlate:
    """Take the upper quartile of a film's pictures where no hand or arm may be: what a shadow passes shows unshaded.

    Args:
        pictures: of a resting camera, `small_enough`.
        covered: where a hand or an arm may be in each, at any size.
        size_px: (width, height) of the plate.
    """
    cv2 = load_opencv()
    small_px = pictures[0].shape[1::-1]
    hidden = [cv2.resize(each.astype(np.uint8), small_px, interpolation=cv2.INTER_NEAREST) > 0 for each in covered]
    seen = np.stack([np.where(mask[..., None], _COVERED, one) for one, mask in zip(pictures, hidden, strict=True)])
    seen.sort(axis=0)  # what is covered comes last
    count = len(pictures) - np.sum(hidden, 0)
    shaded, lit = (
        np.take_along_axis(seen, (share * (count - 1).clip(0)).round().astype(int)[None, ..., None], 0)[0]
        for share in _QUARTILES
    )
    kept = (shaded.astype(np.float32) + _DARK) / (lit.astype(np.float32) + _DARK)
    is_known = (count >= _LEAST_SEEN) & (np.ptp(kept, axis=-1) <= _MOST_TINT)
    plate = cv2.resize(lit, size_px, interpolation=cv2.INTER_LINEAR)
    return CleanPlate(plate, cv2.resize(is_known.astype(np.uint8), size_px, interpolation=cv2.INTER_NEAREST) > 0)


def plate_labels(
    rgb: UInt8[np.ndarray, "H W 3"],
    plate: CleanPlate,
    is_skin: Bool[np.ndarray, "H W"],
    is_ground: Bool[np.ndarray, "H W"],
) -> UInt8[np.ndarray, "H W"]:
    """Label the pixels whose larger part is the hand's or the ground's; `UNKNOWN` where the plate cannot tell.

    It cannot where the ground was not seen, or has skin's colour, where something else is shown, or next to no light.

    Args:
        rgb: a picture of the film.
        plate: of its window.
        is_skin: surely, of which the skin's colours around are taken.
        is_ground: surely, by which the plate gets the picture's exposure and white balance.
    """
    labels = np.full(rgb.shape[:2], UNKNOWN, np.uint8)
    if not is_skin.any():
        return labels
    shown = srgb_to_linear(rgb / np.float32(255))
    ground = _exposed_like(shown, srgb_to_linear(plate.rgb / np.float32(255)), is_ground & plate.is_known)
    skin = _spread(shown, is_skin)
    of_skin, of_ground, is_sure = _unmixed(shown, skin, ground)
    both = of_skin + of_ground
    cv2 = load_opencv()
    share = cv2.medianBlur((of_skin / np.maximum(both, 1e-6)).astype(np.float32), 3)
    from_skin, from_ground = of_skin * skin.sum(-1), of_ground * ground.sum(-1)
    is_pure = is_sure & (from_skin > _PURE * (from_skin + from_ground))
    is_skins = (share > 0.5) & _widened(_opened(is_pure), max(1, round(_MIXED * max(rgb.shape[:2]))))
    is_sure &= plate.is_known & (both > _DARKEST_SHADE)
    labels[is_sure & is_skins & (of_skin > _DARKEST_SKIN)] = HAND
    labels[is_sure & ~is_skins & (both < _BRIGHTEST_GROUND)] = BACKGROUND
    return labels


def _exposed_like(shown: np.ndarray, plate: np.ndarray, both: np.ndarray) -> np.ndarray:
    """Multiply the plate [H, W, 3], linear, by the median gain of the pixels where it is shown."""
    if both.sum() < _LEAST_RING_PX:
        return plate
    return plate * np.median((shown[both] + _NOISE) / (plate[both] + _NOISE), 0)


def _spread(shown: np.ndarray, is_skin: np.ndarray) -> np.ndarray:
    """Compute the mean colour [H, W, 3] of the skin around each pixel."""
    cv2 = load_opencv()
    weight = is_skin.astype(np.float32)
    sums = [np.dstack([shown * weight[..., None], weight]).astype(np.float32)] * 2
    longest_px = max(shown.shape[:2])
    near, far = (
        cv2.GaussianBlur(each, (0, 0), max(1.0, share * longest_px))
        for each, share in zip(sums, (_SKIN_BLUR, _FAR_BLUR), strict=True)
    )
    total = near + _FAR_WEIGHT * far + _FAR_WEIGHT**2 * sums[0].mean((0, 1))
    return total[..., :3] / np.maximum(total[..., 3:], 1e-12)


def _opened(mask: Bool[np.ndarray, "H W"]) -> Bool[np.ndarray, "H W"]:
    cv2 = load_opencv()
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3))) > 0


def _widened(mask: Bool[np.ndarray, "H W"], by_px: int) -> Bool[np.ndarray, "H W"]:
    cv2 = load_opencv()
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * by_px + 1, 2 * by_px + 1))
    return cv2.dilate(mask.astype(np.uint8), disc) > 0


def _unmixed(
    shown: Float[np.ndarray, "H W 3"], skin: Float[np.ndarray, "H W 3"], ground: Float[np.ndarray, "H W 3"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit colours by parts of both that are not negative; returns the parts, and where they explain the colours."""

    def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return (a * b).sum(-1) + _TOGETHER

    skin2, ground2, both = dot(skin, skin), dot(ground, ground), dot(skin, ground)
    with_skin, with_ground = dot(shown, skin), dot(shown, ground)
    apart = skin2 * ground2 - both**2
    of_skin = (with_skin * ground2 - with_ground * both) / np.maximum(apart, 1e-12)
    of_ground = (with_ground * skin2 - with_skin * both) / np.maximum(apart, 1e-12)
    no_skin, no_ground = of_skin < 0, of_ground < 0
    of_skin = np.where(no_skin, 0, np.where(no_ground, with_skin / skin2, of_skin))
    of_ground = np.where(no_ground, 0, np.where(no_skin, with_ground / ground2, of_ground))
    unexplained = np.linalg.norm(shown - of_skin[..., None] * skin - of_ground[..., None] * ground, axis=-1)
    is_explained = unexplained < _MOST_UNEXPLAINED * np.linalg.norm(shown, axis=-1) + _NOISE
    return of_skin, of_ground, is_explained & (apart > _LEAST_APART * skin2 * ground2)
