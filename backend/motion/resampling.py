"""Motions in time: other frame rates, gaps filled, jitter smoothed. Rotations go the short way round, by slerp."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..geometry.rotation import axis_angle_to_quaternion, continuous, quaternion_to_axis_angle
from ..records.errors import LiveHandError
from .motion import HandMotion

_NEARLY_PARALLEL = 1e-6  # of the angle's sine: below it slerp is the straight line
_KERNEL_REACH = 3  # standard deviations


def at_fps(motion: HandMotion, fps: float) -> HandMotion:
    """The same motion at another rate; what goes beyond the last frame is dropped.

    Raises:
        LiveHandError: the motion's own rate is not known, or `fps` is not positive.
    """
    if motion.fps is None:
        raise LiveHandError("the motion's own frame rate must be known to change it, got none; state it")
    if not (np.isfinite(fps) and fps > 0):
        raise LiveHandError(f"fps must be a positive number, got {fps}")
    # A whisker more, so that the last frame is not lost to rounding.
    count = int(np.floor((len(motion) - 1) * fps / motion.fps + 1e-6)) + 1
    return replace(at_frames(motion, np.arange(count) * (motion.fps / fps)), fps=fps)


def at_frames(motion: HandMotion, positions: np.ndarray, places: np.ndarray | None = None) -> HandMotion:
    """The motion at positions [M] on its own axis of frames, fractions among them; at its ends it stands still.

    Args:
        motion: of T frames.
        positions: where to read.
        places: [T] increasing, where its frames lie; None: 0, 1, 2, ...
    """
    places = np.arange(len(motion)) if places is None else places
    left = np.clip(np.searchsorted(places, positions, "right") - 1, 0, max(len(places) - 2, 0))
    right = np.minimum(left + 1, len(places) - 1)
    span = np.maximum(places[right] - places[left], 1)
    share = np.clip((positions - places[left]) / span, 0, 1)
    quaternions = axis_angle_to_quaternion(motion.theta)
    turned = slerp(quaternions[left], quaternions[right], share[:, None])
    transl = _between(motion.transl[left], motion.transl[right], share)
    beta = motion.beta if motion.beta.ndim == 1 else _between(motion.beta[left], motion.beta[right], share)
    return replace(motion, theta=quaternion_to_axis_angle(turned), beta=beta, transl=transl)


def slerp(start: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Unit quaternions [..., 4] on the shorter arc between two; share [...] is 0 at the start and 1 at the end."""
    dot = (start * end).sum(-1, keepdims=True)
    end, dot = np.where(dot < 0, -end, end), np.minimum(np.abs(dot), 1)
    angle = np.arccos(dot)
    sine, share = np.sin(angle), share[..., None]
    is_close = sine < _NEARLY_PARALLEL
    safe = np.where(is_close, 1, sine)
    from_start = np.where(is_close, 1 - share, np.sin((1 - share) * angle) / safe)
    mixed = from_start * start + np.where(is_close, share, np.sin(share * angle) / safe) * end
    return mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)


def smoothed(motion: HandMotion, frames: float) -> HandMotion:
    """The motion without its jitter: a Gaussian mean over time with a deviation of `frames`; 0 changes nothing."""
    if frames <= 0 or len(motion) == 1:
        return motion
    quaternions = _mean_over_time(continuous(axis_angle_to_quaternion(motion.theta)), frames)
    quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
    return replace(motion, theta=quaternion_to_axis_angle(quaternions), transl=_mean_over_time(motion.transl, frames))


def _mean_over_time(values: np.ndarray, frames: float) -> np.ndarray:
    reach = int(np.ceil(_KERNEL_REACH * frames))
    total, weights = np.zeros_like(values), np.zeros(len(values))
    for step in range(-min(reach, len(values) - 1), min(reach, len(values) - 1) + 1):
        weight = np.exp(-0.5 * (step / frames) ** 2)
        to, source = (slice(max(-step, 0), len(values) - max(step, 0)), slice(max(step, 0), len(values) + min(step, 0)))
        total[to] += weight * values[source]
        weights[to] += weight
    return total / weights.reshape(-1, *(1,) * (values.ndim - 1))


def _between(start: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
    return start + share[:, None] * (end - start)
