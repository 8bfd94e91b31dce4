"""Resampling, gap filling and smoothing of motions in time. Rotations are interpolated by slerp."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..geometry.rotation import axis_angle_to_quaternion, continuous, quaternion_to_axis_angle
from ..records.errors import LiveHandError
from .motion import HandMotion

_LEAST_SINE = 1e-6  # of the angle between two quaternions; below it slerp is linear
_KERNEL_RADIUS = 3  # standard deviations


def resampled(motion: HandMotion, fps: float, start: float = 0.0) -> HandMotion:
    """Resample the motion at another frame rate, from `start` frames on; samples after the last frame are dropped.

    Raises:
        LiveHandError: the motion's own rate is unknown, or `fps` is not positive.
    """
    if motion.fps is None:
        raise LiveHandError("the motion's own frame rate must be known to change it, got none; state it")
    if not (np.isfinite(fps) and fps > 0):
        raise LiveHandError(f"fps must be a positive number, got {fps}")
    # The small tolerance keeps the last frame in spite of rounding.
    count = max(1, int(np.floor((len(motion) - 1 - start) * fps / motion.fps + 1e-6)) + 1)
    return replace(sampled_at(motion, start + np.arange(count) * (motion.fps / fps)), fps=fps)


def sampled_at(motion: HandMotion, positions: np.ndarray, times: np.ndarray | None = None) -> HandMotion:
    """Sample the motion at positions [M] on the time axis of its frames; constant before the first and after the last.

    Args:
        motion: of T frames.
        positions: where to sample, fractions included.
        times: [T] increasing times of the motion's frames; None means 0, 1, 2, ...
    """
    times = np.arange(len(motion)) if times is None else times
    left = np.clip(np.searchsorted(times, positions, "right") - 1, 0, max(len(times) - 2, 0))
    right = np.minimum(left + 1, len(times) - 1)
    span = times[right] - times[left]
    t = np.clip((positions - times[left]) / np.where(span > 0, span, 1), 0, 1)
    theta = _turned(motion.theta[left], motion.theta[right], t[:, None])
    forearm = motion.forearm if motion.forearm.ndim == 1 else _turned(motion.forearm[left], motion.forearm[right], t)
    transl = _lerp(motion.transl[left], motion.transl[right], t)
    beta = motion.beta if motion.beta.ndim == 1 else _lerp(motion.beta[left], motion.beta[right], t)
    return replace(motion, theta=theta, beta=beta, transl=transl, forearm=forearm)


def _turned(start: np.ndarray, end: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Interpolate axis-angles [..., 3] on the shorter arc between two; t [...] is 0 at the start and 1 at the end."""
    return quaternion_to_axis_angle(slerp(axis_angle_to_quaternion(start), axis_angle_to_quaternion(end), t))


def slerp(start: np.ndarray, end: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Interpolate unit quaternions [..., 4] on the shorter arc; t [...] is 0 at the start and 1 at the end."""
    dot = (start * end).sum(-1, keepdims=True)
    end, dot = np.where(dot < 0, -end, end), np.minimum(np.abs(dot), 1)
    angle = np.arccos(dot)
    sine, t = np.sin(angle), t[..., None]
    is_close = sine < _LEAST_SINE
    safe = np.where(is_close, 1, sine)
    from_start = np.where(is_close, 1 - t, np.sin((1 - t) * angle) / safe)
    mixed = from_start * start + np.where(is_close, t, np.sin(t * angle) / safe) * end
    return mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)


def smoothed(motion: HandMotion, frames: float) -> HandMotion:
    """Smooth the motion by a Gaussian filter with a standard deviation of `frames`; 0 changes nothing."""
    if frames <= 0 or len(motion) == 1:
        return motion
    forearm = motion.forearm if motion.forearm.ndim == 1 else _smoothed_turns(motion.forearm, frames)
    theta, transl = _smoothed_turns(motion.theta, frames), _gaussian_mean(motion.transl, frames)
    return replace(motion, theta=theta, transl=transl, forearm=forearm)


def _smoothed_turns(turns: np.ndarray, deviation: float) -> np.ndarray:
    """Smooth axis-angles [T, ..., 3] through the mean of their quaternions."""
    quaternions = _gaussian_mean(continuous(axis_angle_to_quaternion(turns)), deviation)
    return quaternion_to_axis_angle(quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True))


def _gaussian_mean(values: np.ndarray, deviation: float) -> np.ndarray:
    """Average along the first axis; near the ends the kernel is cut and its weights are normalised."""
    count = len(values)
    radius = min(int(np.ceil(_KERNEL_RADIUS * deviation)), count - 1)
    total, weights = np.zeros_like(values), np.zeros(count)
    for step in range(-radius, radius + 1):
        weight = np.exp(-0.5 * (step / deviation) ** 2)
        target = slice(max(-step, 0), count - max(step, 0))
        total[target] += weight * values[max(step, 0) : count + min(step, 0)]
        weights[target] += weight
    return total / weights.reshape(-1, *(1,) * (values.ndim - 1))


def _lerp(start: np.ndarray, end: np.ndarray, t: np.ndarray) -> np.ndarray:
    return start + t[:, None] * (end - start)
