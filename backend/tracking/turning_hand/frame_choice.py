"""Which frames of a film of a turning hand become a capture: sharp, well fitted, and spread over its poses."""

from __future__ import annotations

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix
from ...motion.motion import HandMotion
from ...records.errors import LiveHandError

MOST_CHOSEN, LEAST_CHOSEN = 120, 20
_KEPT_SHARE = 0.8  # of the frames, by fit error and blur
_LEAST_APART_RAD = np.deg2rad(2.5)
_MOST_APART_RAD = 2.0
_HALVINGS = 20
_COARSE_PX = 4
_EXPOSURE_S = 1 / 60  # of a frame, indoors
_MOST_SMEAR = 0.03  # of enough frames
_FARTHEST_S = 1.0  # of a frame by which a speed is told
_FAST_SHARE = 0.9  # of the joints move at most so fast
_LEAST_STEP = 1e-6
_HELD_OUT_AT, _HELD_OUT_SHARE = (0.25, 0.75), 0.1  # middles of the stretches; their part of all frames


def chosen_frames(
    motion: HandMotion,
    fit_error: np.ndarray,
    blur: np.ndarray,
    smear: np.ndarray,
    least: int = LEAST_CHOSEN,
    most: int = MOST_CHOSEN,
) -> np.ndarray:
    """Choose frames that lie apart in pose, as increasing indices; of those that lie together, the best.

    Where there are enough others, no frame is chosen in which the hand moves fast.

    Args:
        motion: of the T frames.
        fit_error: [T] of the fit.
        blur: [T] of the picture, as `blur_of` has it.
        smear: [T] of the hand, as `smear_of` has it.
        least: number of them.
        most: number of them.

    Raises:
        LiveHandError: there are too few.
    """
    badness = fit_error / max(float(np.median(fit_error)), 1e-9) + blur / max(float(np.median(blur)), 1e-9)
    best = np.argsort(badness + smear / _MOST_SMEAR, kind="stable")[: max(1, round(_KEPT_SHARE * len(motion)))]
    calm = best[smear[best] <= _MOST_SMEAR]
    best = calm if len(calm) >= most else best
    points = _points(motion)[best]
    kept = _apart(points, _LEAST_APART_RAD)
    if len(kept) < least:
        raise LiveHandError(
            f"a capture needs a hand that turns: at least {least} sharp frames of poses that differ, "
            f"got {len(kept)}; turn the hand slowly before the camera, for half a minute"
        )
    near, far = _LEAST_APART_RAD, _MOST_APART_RAD
    for _ in range(_HALVINGS if len(kept) > most else 0):
        middle = (near + far) / 2
        some = _apart(points, middle)
        if len(some) > most:
            near = middle
        else:
            far, kept = middle, some
    return np.sort(best[kept])


def held_out(count: int) -> np.ndarray:
    """Mark [count] the chosen frames, in order of time, that are held out: two stretches of the turn."""
    length = max(1, round(_HELD_OUT_SHARE * count / len(_HELD_OUT_AT)))
    is_out = np.zeros(count, bool)
    for share in _HELD_OUT_AT:
        first = round(share * count - length / 2)
        is_out[first : first + length] = True
    return is_out


def blur_of(picture: np.ndarray) -> float:
    """Measure how blurred uint8 [H, W, 3] is, 0..1: its change over four pixels against four times that over one.

    The blurrier of the two directions counts, for a hand that moves is blurred in one.
    """
    grey = picture.astype(np.float32).mean(-1)
    blurs = []
    for axis in range(2):
        across = np.moveaxis(grey, axis, 0)
        if len(across) <= _COARSE_PX:
            continue
        coarse = float(np.abs(across[_COARSE_PX:] - across[:-_COARSE_PX]).mean())
        blurs.append(coarse / max(_COARSE_PX * float(np.abs(np.diff(across, axis=0)).mean()), _LEAST_STEP))
    return min(1.0, max(blurs, default=1.0))


def smear_of(px: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    """Estimate how far a hand moves while each frame is exposed [T], over its size in the picture.

    Args:
        px: [T, 21, 2] landmarks.
        times_s: [T], increasing.
    """
    sizes_px = np.maximum(np.ptp(px, axis=1).max(-1), 1e-6)
    apart_s = np.diff(times_s)
    speeds = np.linalg.norm(np.diff(px, axis=0), axis=-1) / np.maximum(apart_s, 1e-6)[:, None]
    is_sure = apart_s <= _FARTHEST_S
    padded = np.zeros((2, len(px), px.shape[1]))
    padded[0, 1:], padded[1, :-1] = speeds, speeds
    weights = np.zeros((2, len(px), 1))
    weights[0, 1:, 0], weights[1, :-1, 0] = is_sure, is_sure
    mean = (padded * weights).sum(0) / np.maximum(weights.sum(0), 1)
    return _EXPOSURE_S * np.quantile(mean, _FAST_SHARE, axis=-1) / sizes_px


def _points(motion: HandMotion) -> np.ndarray:
    """Embed frames as points [T, 54] whose distance is the hand's turn and the fingers' mean turn, rad, nearly."""
    count = len(motion)
    root = axis_angle_to_matrix(motion.theta[:, 0]).reshape(count, 9) / np.sqrt(2)
    return np.concatenate([root, motion.theta[:, 1:].reshape(count, 45) / np.sqrt(15)], 1)


def _apart(points: np.ndarray, distance: float) -> np.ndarray:
    """Select points, as indices, that are at least so far from all that were taken before them."""
    taken: list[int] = []
    nearest = np.full(len(points), np.inf)
    for index in range(len(points)):
        if nearest[index] >= distance:
            taken.append(index)
            nearest = np.minimum(nearest, np.linalg.norm(points - points[index], axis=1))
    return np.array(taken)
