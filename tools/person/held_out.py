"""How near a person comes to a picture that the person was not made from.

Values are compared as the camera encodes them, after the best gain and bias a channel, clipped as a camera clips. What
the picture does not tell (`UNKNOWN`) counts as black in both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_erosion
from scipy.optimize import least_squares

from ...backend.capture.picture import linear_to_srgb
from ...backend.person.lit_model.flow import flow_between, local_contrast
from ...backend.person.lit_model.illumination import Illumination
from ...backend.person.lit_model.model import PersonModel
from ...backend.records.camera import Camera
from ...backend.records.hand_picture import HAND, UNKNOWN, HandPicture

_INNER_PX = 3
_CLIPPED = 0.97
_FITTED_PIXELS = 20_000
_WHITE, _WHITE_PERCENTILE = 0.8, 99.8  # of the render before the best gain
_SHIFTS, _SHIFT_SHARE = 2, 0.9
_BAND_PX = 10.0
_FLOW_INNER_PX, _FLOW_ERROR_PX = 4, 1.4

Distance = Callable[[np.ndarray, np.ndarray], float]
"""Of two encoded pictures [H, W, 3]."""


class HeldOutFigures(NamedTuple):
    """Of one picture.

    Attributes:
        mask_db: PSNR on the hand's pixels.
        inner_db: PSNR 3 px inside their outline.
        iou: of the hand's pixels and the person's.
        lpips: of the crop; NaN if not measured.
        shift_px: by which the picture was moved to the person, x and y.
    """

    mask_db: float
    inner_db: float
    iou: float
    lpips: float
    shift_px: tuple[float, float]


def measured(
    model: PersonModel, picture: HandPicture, light: Illumination, distance: Distance | None = None
) -> tuple[HeldOutFigures, np.ndarray]:
    """Measure a person in a picture's pose; returns the figures and the compared render [H, W, 3], encoded, on black.

    The camera is moved first by the two numbers of the median flow, the hand resting, where that brings them nearer.

    Args:
        model: the person.
        picture: held out.
        light: of its scene.
        distance: LPIPS, of encoded pictures.
    """
    cameras = [picture.camera]
    for _ in range(_SHIFTS):
        cameras.append(_shifted(cameras[-1], picture, *_encoded(model, picture, cameras[-1], light)))
    tries = [compared(*_encoded(model, picture, camera, light), picture) for camera in (cameras[0], cameras[-1])]
    best = max((0, 1), key=lambda index: tries[index][0].mask_db)
    camera = (cameras[0], cameras[-1])[best]
    x, y = camera.K[:2, 2] - picture.camera.K[:2, 2]
    figures, image = compared(*_encoded(model, picture, camera, light), picture, distance)
    return figures._replace(shift_px=(float(x), float(y))), image


def compared(
    encoded: Float[np.ndarray, "H W 3"],
    alpha: Float[np.ndarray, "H W"],
    picture: HandPicture,
    distance: Distance | None = None,
) -> tuple[HeldOutFigures, np.ndarray]:
    """Compare a render, encoded, straight, with a picture; returns the figures and the render as it was compared."""
    is_hand, is_known = picture.labels == HAND, picture.labels != UNKNOWN
    shown = picture.rgb / 255.0
    gains = best_gains(encoded[is_hand & (alpha > 0.5)], shown[is_hand & (alpha > 0.5)])
    opacity = alpha * is_known
    ours = (encoded * gains[:, 0] + gains[:, 1]).clip(0, 1) * opacity[..., None]
    theirs = shown * is_hand[..., None]
    inner = binary_erosion(is_hand, np.ones((3, 3)), iterations=_INNER_PX)
    is_ours = opacity > 0.5
    rows, columns = np.nonzero(is_hand)
    box = slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)
    figures = HeldOutFigures(
        mask_db=psnr_db(ours, theirs, is_hand),
        inner_db=psnr_db(ours, theirs, inner),
        iou=float((is_ours & is_hand).sum() / (is_ours | is_hand).sum()),
        lpips=float("nan") if distance is None else distance(theirs[box], ours[box]),
        shift_px=(0.0, 0.0),
    )
    return figures, ours


def best_gains(rendered: Float[np.ndarray, "P 3"], shown: Float[np.ndarray, "P 3"]) -> Float[np.ndarray, "3 2"]:
    """Find the gain and bias of each channel that bring the clipped render nearest to what is shown."""
    step = max(1, len(rendered) // _FITTED_PIXELS)
    found = []
    for channel in range(3):
        x, target = rendered[::step, channel].astype(float), shown[::step, channel].astype(float)
        design = np.stack([x, np.ones_like(x)], 1)
        is_free = target < _CLIPPED
        starts = [np.array([np.median(target / np.maximum(x, 0.02)), 0.0])]
        rows = [part for part in (is_free | True, is_free) if part.sum() > 2]
        starts += [np.linalg.lstsq(design[part], target[part], rcond=None)[0] for part in rows]
        fits = [least_squares(lambda s: (design @ s).clip(0, 1) - target, start) for start in starts]  # noqa: B023
        found.append(min(fits, key=lambda fit: fit.cost).x)
    return np.array(found)


def psnr_db(one: np.ndarray, other: np.ndarray, where: Bool[np.ndarray, "H W"]) -> float:
    """Compute the peak signal-to-noise ratio of pictures [H, W, 3] in [0, 1] on a mask, dB."""
    return float(-10 * np.log10(((one - other)[where] ** 2).mean() + 1e-12))


def _encoded(
    model: PersonModel, picture: HandPicture, camera: Camera, light: Illumination
) -> tuple[np.ndarray, np.ndarray]:
    frame = model.rendered(picture.pose, camera, light.light)
    linear = frame.rgb / np.maximum(frame.alpha[..., None], 1e-3) * light.tint.astype(np.float32)
    white = np.percentile(linear[frame.alpha > 0.5], _WHITE_PERCENTILE)
    return linear_to_srgb((linear * (_WHITE / white)).clip(0, 1)), frame.alpha


def _shifted(camera: Camera, picture: HandPicture, encoded: np.ndarray, alpha: np.ndarray) -> Camera:
    """Move the principal point by the median flow from the render to the picture."""
    both = (picture.labels == HAND) & (alpha > 0.5)
    flow = flow_between(
        local_contrast(encoded, both, _BAND_PX), local_contrast(picture.rgb / 255.0, both, _BAND_PX), finest_level=0
    )
    inner = np.asarray(binary_erosion(both, np.ones((3, 3)), iterations=_FLOW_INNER_PX), bool)
    sure = inner & (flow.error_px < _FLOW_ERROR_PX)
    if not sure.any():
        return camera
    K = camera.K.copy()
    K[:2, 2] += _SHIFT_SHARE * np.median(flow.px[sure], 0)
    return replace(camera, K=K)
