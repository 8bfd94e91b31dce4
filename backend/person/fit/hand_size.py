"""The hand's length, which one camera cannot see: a large hand far away looks like a small one near by.

Its proportions, of palm and fingers, landmarks see badly: a tracker's hands all have much the same. Fits begin better
with the mean hand's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from ...hand.measurements import fit_beta, length_and_breadth_m, measurement_slopes
from ...hand.model import HandModel
from ...motion.spaces import rest_wrists
from ...records.errors import LiveHandError
from ...records.hand_picture import HandPicture, PicturedHand

LENGTH_LIMITS_M = 0.1, 0.25  # of a child to the longest
_DEVIATION_M = 0.001  # of a ruler


def sized(hand: PicturedHand, model: HandModel, length_m: float) -> PicturedHand:
    """Give the hand its length, as far away as lets it look the same; its proportions are kept.

    Args:
        hand: with poses of one shape.
        model: of the poses.
        length_m: from the wrist to the tip of the straight middle finger.

    Raises:
        LiveHandError: no hand is so long, or the cameras are calibrated and know better.
    """
    check_length(length_m)
    if _is_measured(hand):
        raise LiveHandError("the hand's length must be left to calibrated cameras, which know it, got --length-mm")
    beta = hand.pictures[0].pose.beta
    now = length_and_breadth_m(model, beta)
    larger_by = length_m / now[0]
    shape = fit_beta(model, *(now * larger_by), near=beta)
    return replace(hand, pictures=tuple(_moved(picture, model, shape, larger_by) for picture in hand.pictures))


def with_mean_proportions(hand: PicturedHand, model: HandModel) -> PicturedHand:
    """Keep the hand's length and breadth alone; its other proportions are the mean hand's.

    Args:
        hand: with poses of one shape; that of calibrated cameras, or of a capture, is known better and stays.
        model: of the poses.
    """
    if _is_measured(hand):
        return hand
    beta = hand.pictures[0].pose.beta
    shape = fit_beta(model, *length_and_breadth_m(model, beta))
    return replace(hand, pictures=tuple(_moved(picture, model, shape, 1.0) for picture in hand.pictures))


def _is_measured(hand: PicturedHand) -> bool:
    return hand.is_calibrated or any(picture.moment is not None for picture in hand.pictures)


def check_length(length_m: float) -> None:
    """Raise LiveHandError if no hand is so long."""
    low, high = LENGTH_LIMITS_M
    if not low <= length_m <= high:
        raise LiveHandError(
            f"the hand's length must be from {1000 * low:.0f} to {1000 * high:.0f} mm, got {1000 * length_m:g}; "
            "measure from the wrist's crease to the tip of the straight middle finger"
        )


def _moved(picture: HandPicture, model: HandModel, beta: np.ndarray, farther_by: float) -> HandPicture:
    pose, origin = picture.pose, picture.camera.origin
    wrist = rest_wrists(model, pose.beta) + pose.transl
    transl = origin + farther_by * (wrist - origin) - rest_wrists(model, beta)
    return replace(picture, pose=replace(pose, beta=beta, transl=transl))


@dataclass(frozen=True)
class LengthPrior:
    """Holds a shape that is fitted to a length, to a millimetre.

    Attributes:
        beta: [10] about which the length is linear.
        length_m: of it.
        slope_m: [10] by which it grows.
        wanted_m: the length.
    """

    beta: Tensor
    length_m: float
    slope_m: Tensor
    wanted_m: float

    @classmethod
    def of(cls, model: HandModel, beta: np.ndarray, wanted_m: float) -> LengthPrior:
        """Measure a shape [10]."""
        length, slope = length_and_breadth_m(model, beta)[0], measurement_slopes(model, beta)[0]
        about, slope_m = (torch.as_tensor(values, dtype=torch.float32) for values in (beta, slope))
        return cls(about, float(length), slope_m, wanted_m)

    def loss(self, beta: Tensor) -> Tensor:
        """Return half the square of the error in deviations."""
        error_m = self.length_m + self.slope_m @ (beta - self.beta) - self.wanted_m
        return 0.5 * (error_m / _DEVIATION_M) ** 2
