"""Dense flow between two pictures (DIS, Kroeger et al. 2016, of OpenCV), with how far its two directions disagree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...capture.masks.mask import load_opencv

_LEAST_SHARE = 1e-3
_WINDOW_PX, _SURE_SLOPE = 5.0, 0.04  # about as far as flow looks; of grey, a px, along which it hardly slides
_NOTHING = 1e-12  # of its square
_CONTRAST, _FLOOR = 0.14, 0.008  # deviation from grey of what has more than the floor's


class Flow(NamedTuple):
    """Where the pixels of one picture are in another.

    Attributes:
        px: [H, W, 2] displacements.
        error_px: [H, W] by which going there and back misses a pixel's own place.
    """

    px: np.ndarray
    error_px: np.ndarray


def flow_between(first: np.ndarray, second: np.ndarray, smooth_px: float = 2.0, finest_level: int = 1) -> Flow:
    """Find where pixels of a grey picture [H, W] in [0, 1] are in another.

    Args:
        first: whose pixels are looked for.
        second: where they are looked for.
        smooth_px: deviation of the blur of the flow.
        finest_level: of the pyramid; 0: full size.
    """
    cv2 = load_opencv()
    search = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    search.setFinestScale(finest_level)
    grey = [(255 * picture).clip(0, 255).astype(np.uint8) for picture in (first, second)]
    there = cv2.GaussianBlur(search.calc(grey[0], grey[1], None), (0, 0), smooth_px)
    back = search.calc(grey[1], grey[0], None)
    rows, columns = np.mgrid[: first.shape[0], : first.shape[1]].astype(np.float32)
    return_px = cv2.remap(back, columns + there[..., 0], rows + there[..., 1], cv2.INTER_LINEAR)
    return Flow(there, np.linalg.norm(there + return_px, axis=-1))


def local_contrast(encoded: np.ndarray, where: np.ndarray, around_px: float) -> np.ndarray:
    """Return the fine structure [H, W] of a picture [H, W, 3] where a mask is set, in the same contrast everywhere."""
    cv2 = load_opencv()

    def around(values: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(values, (0, 0), around_px)

    grey, mask = encoded.mean(-1).astype(np.float32), where.astype(np.float32)
    share = np.maximum(around(mask), _LEAST_SHARE)
    fine = (grey - around(grey * mask) / share) * mask
    return 0.5 + _CONTRAST * fine / (np.sqrt(around(fine * fine) / share) + _FLOOR)


def flow_reliability(grey: np.ndarray, xy_px: np.ndarray) -> np.ndarray:
    """Return the matrices [P, 2, 2] that take of a flow at points [P, 2] what a grey picture [H, W] tells.

    Along a straight edge one place looks like the next, and flow slides: only what is across counts. Where nothing is
    to be seen at all, flow is its neighbours', and counts as it is.
    """
    cv2 = load_opencv()
    slopes = [cv2.Sobel(grey.astype(np.float32), cv2.CV_32F, *axes, ksize=3, scale=1 / 8) for axes in ((1, 0), (0, 1))]
    products = [cv2.GaussianBlur(one * other, (0, 0), _WINDOW_PX) for one in slopes for other in slopes]
    strength, direction = np.linalg.eigh(bilinear(np.stack(products, -1), xy_px).reshape(-1, 2, 2))
    strength = strength.clip(_NOTHING)
    share = strength / (strength + _SURE_SLOPE**2)
    return (direction * np.sqrt(share / share[:, 1:])[:, None]) @ direction.swapaxes(1, 2)


def bilinear(image: np.ndarray, xy_px: np.ndarray) -> np.ndarray:
    """Sample an image [H, W, ...] at points [P, 2], px, pixel centres at .5; zero outside it."""
    height, width = image.shape[:2]
    place = xy_px - 0.5
    is_inside = np.logical_and(place >= 0, place <= (width - 1, height - 1)).all(1)
    place = place.clip(0, (width - 1.001, height - 1.001))
    x, y = place.astype(int).T
    extra = (slice(None), *(None,) * (image.ndim - 2))
    right, below = (place[:, axis] - corner for axis, corner in ((0, x), (1, y)))
    right, below = right[extra], below[extra]
    top = image[y, x] * (1 - right) + image[y, x + 1] * right
    bottom = image[y + 1, x] * (1 - right) + image[y + 1, x + 1] * right
    return (top * (1 - below) + bottom * below) * is_inside[extra]


def nearest(image: np.ndarray, xy_px: np.ndarray) -> np.ndarray:
    """Look up the pixels of an image [H, W, ...] that points [P, 2], px, lie in; those of its rim outside it."""
    height, width = image.shape[:2]
    column, row = np.floor(xy_px).astype(int).T
    return image[row.clip(0, height - 1), column.clip(0, width - 1)]
