"""Exposure and white balance of the cameras that saw one hand at the same moments.

The light on a spot of skin is the same for all cameras that see it at one moment: what one of them shows brighter is
its gain. Spots that shine towards one camera contradict the others and count little.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch

from ..capture.masks.mask import load_opencv
from ..capture.picture import srgb_to_linear
from ..geometry.mesh_tables import area_weighted_normals
from ..geometry.rasterise import nearest_fronts, rasterise
from ..hand.lbs import posed_vertices
from ..hand.model import HandModel
from ..records.hand_picture import HAND, HandPicture, PicturedHand
from ..records.side import Side
from .lit_model.flow import bilinear, nearest

_LEAST_FACING, _BEHIND_M = 0.5, 0.004
_DARKEST, _BRIGHTEST = 0.04, 0.97  # encoded
_BLUR = 0.006  # of the picture's longer side: poses are off by millimetres
_SAME = 0.1  # of the logarithm: spots that differ by more shine, or are not the same
_PRIOR = 0.5  # deviation of a camera's gain, of the logarithm
_ROUNDS = 8
_LEAST_GAIN = 0.03  # below it, shine and errors of poses are as large


def camera_log_gains(pictures: Sequence[HandPicture], model: HandModel) -> dict[int, tuple[float, float, float]]:
    """Estimate the logarithm of each camera's gain, their mean 0; without pictures of one moment all are 0.

    Args:
        pictures: with poses that are about right.
        model: the right hand's.
    """
    cameras = sorted({picture.camera_index for picture in pictures})
    moments = sorted({picture.moment for picture in pictures if picture.moment is not None})
    count = len(model.v_template)
    values = np.full((len(cameras), len(moments) * count, 3), np.nan)
    for picture in pictures:
        if picture.moment is not None:
            start = moments.index(picture.moment) * count
            values[cameras.index(picture.camera_index), start : start + count] = _colours(picture, model)
    gains = relative_gains(values)
    if np.abs(gains).max(initial=0.0) < _LEAST_GAIN:
        gains[:] = 0
    return {camera: (float(r), float(g), float(b)) for camera, (r, g, b) in zip(cameras, gains, strict=True)}


def with_camera_gains(hands: Mapping[Side, PicturedHand], model: HandModel) -> dict[Side, PicturedHand]:
    """Give the pictures of a rig's hands their cameras' gains, which the skin of all hands tells.

    Args:
        hands: of one person at one moment; those of cameras held out keep theirs.
        model: the right hand's.
    """
    shown = [
        replace(picture, moment=number)
        for number, hand in enumerate(hands.values())
        for picture in hand.pictures
        if not picture.is_held_out
    ]
    gains = camera_log_gains(shown, model)

    def given(picture: HandPicture) -> HandPicture:
        return replace(picture, log_gain=gains.get(picture.camera_index, picture.log_gain))

    return {side: replace(hand, pictures=tuple(map(given, hand.pictures))) for side, hand in hands.items()}


def relative_gains(values: np.ndarray) -> np.ndarray:
    """Solve for gains [C, 3] of cameras that see the same spots.

    Args:
        values: [C, N, 3] logarithms of colours; NaN where a camera does not show a spot.
    """
    shown = np.isfinite(values[..., 0])
    shared = shown & (shown.sum(0) > 1)
    gains = np.zeros((len(values), values.shape[2]))
    if not shared.any():
        return gains
    colours = np.where(shared[..., None], values, 0)
    weight = shared.astype(np.float64)
    for _ in range(_ROUNDS):
        total = weight.sum(0).clip(1e-9)
        system = np.diag(weight.sum(1)) - (weight / total) @ weight.T
        system += (_SAME / _PRIOR) ** 2 * np.eye(len(values))
        mean = (weight[..., None] * colours).sum(0) / total[:, None]
        gains = np.linalg.solve(system, (weight[..., None] * (colours - mean)).sum(1))
        spot = (weight[..., None] * (colours - gains[:, None])).sum(0) / total[:, None]
        off = (colours - gains[:, None] - spot).mean(-1)
        weight = shared / (1 + (off / _SAME) ** 2)
    return gains - gains.mean(0)


def _colours(picture: HandPicture, model: HandModel) -> np.ndarray:
    """Return the logarithm [V, 3] of the linear colour that a picture shows at vertices; NaN where it does not."""
    cv2 = load_opencv()
    vertices = posed_vertices(model, picture.pose)
    normals, away = area_weighted_normals(vertices, model.f), vertices - picture.camera.origin
    facing = -(normals * away).sum(1) / np.linalg.norm(away, axis=1)
    px, depth = picture.camera.project(vertices)
    size_px = picture.camera.size_px
    found = rasterise(torch.as_tensor(px), torch.as_tensor(depth), torch.as_tensor(model.f), size_px)
    front = nearest_fronts(found, size_px).depth.numpy().reshape(size_px[::-1])
    inside = ((px >= 1) & (px < np.array(size_px) - 1)).all(1)
    is_visible = inside & (facing > _LEAST_FACING) & (depth < nearest(front, px) + _BEHIND_M)
    blur_px = max(0.5, _BLUR * max(size_px))
    is_hand = (picture.labels == HAND).astype(np.float32)
    share = cv2.GaussianBlur(is_hand, (0, 0), blur_px)
    encoded = picture.rgb.astype(np.float32) / 255
    linear = cv2.GaussianBlur(srgb_to_linear(encoded) * is_hand[..., None], (0, 0), blur_px)
    is_usable = is_hand * (encoded.max(-1) < _BRIGHTEST) * (encoded.max(-1) > _DARKEST)
    is_visible &= (bilinear(is_usable, px) > 0.99) & (bilinear(share, px) > 0.7)
    colour = bilinear(linear, px) / np.maximum(bilinear(share, px), 1e-3)[:, None]
    return np.where(is_visible[:, None], np.log(colour + 1e-4), np.nan)
