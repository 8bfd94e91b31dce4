"""Grasps over a shot, without pops: each frame's changes of the pose are smoothed, and the joints settle once more.

Before a digit touches for the first time, and after it has let go, its change is eased in and out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..records.errors import LiveHandError
from ..records.shot import HandPose
from .grasp import Grasp, Grasper, GraspOptions, NothingInReach
from .placed_solids import PlacedSolid

_EASE_FRAMES = 10
_SMOOTH_FRAMES = 2.0
_CLOSING_SHARE = 0.7  # of the work
_LEAST_RUN = 5  # frames; shorter touches are filled or left out


def grasped_shot(
    grasper: Grasper,
    poses: Sequence[HandPose],
    things: Sequence[Sequence[PlacedSolid]],
    options: GraspOptions,
    report: Callable[[float], None] = lambda share: None,
) -> list[Grasp]:
    """Close a hand on things in T frames.

    Args:
        grasper: of the hand and its shape.
        poses: the animator's, all of one side.
        things: of each frame, in the hand's own space.
        options: how; the wrist is never moved.
        report: called after every frame with the share of the work that is done; it may raise anything to end it.

    Raises:
        LiveHandError: no frame reaches anything, or the palm is inside a thing.
    """
    if poses[0].side == "left":
        mirrored = [[one.mirrored() for one in row] for row in things]
        found = grasped_shot(grasper, [pose.mirrored() for pose in poses], mirrored, options, report)
        return [replace(one, pose=one.pose.mirrored()) for one in found]
    given = np.stack([grasper.angles(pose) for pose in poses])
    changes, touches = np.zeros_like(given), np.zeros((len(poses), 5), bool)
    for frame, (pose, row) in enumerate(zip(poses, things, strict=True)):
        grasp = _grasp(grasper, pose, row, replace(options, moves_wrist=False), frame)
        if grasp is not None:
            changes[frame] = grasper.angles(grasp.pose) - given[frame]
            touches[frame] = grasper.touching_digits(grasp)
        report(_CLOSING_SHARE * (frame + 1) / len(poses))
    if not touches.any():
        raise LiveHandError("a finger must reach the object in some frame, none does; bring the hand nearer")
    touches = _steady(touches)
    wanted = given + _eased(changes, touches)
    found = []
    for frame, (pose, row) in enumerate(zip(poses, things, strict=True)):
        settled = grasper.settled(pose, row, wanted[frame], touches[frame], options)
        found.append(grasper.measured(settled, row))
        report(_CLOSING_SHARE + (1 - _CLOSING_SHARE) * (frame + 1) / len(poses))
    return found


def _grasp(
    grasper: Grasper, pose: HandPose, things: Sequence[PlacedSolid], options: GraspOptions, frame: int
) -> Grasp | None:
    """Grasp in a frame; None: nothing is within reach."""
    try:
        return grasper.grasp(pose, things, options)
    except NothingInReach:
        return None
    except LiveHandError as error:
        raise LiveHandError(f"in frame {frame + 1} of the range, {error}") from error


def _steady(touches: np.ndarray) -> np.ndarray:
    """Fill short gaps in touches [T, 5], and leave short ones out: each is as most of those around it."""
    size = min(_LEAST_RUN, len(touches))
    around = _windows(touches.astype(float), size)
    return around.sum(-1) >= size - size // 2


def _smoothed(changes: np.ndarray) -> np.ndarray:
    """Blur changes [T, ...] over frames by a Gaussian."""
    reach = round(4 * _SMOOTH_FRAMES)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / _SMOOTH_FRAMES) ** 2)
    return _windows(changes, 2 * reach + 1) @ (weights / weights.sum())


def _windows(values: np.ndarray, size: int) -> np.ndarray:
    """Return the values [T, ..., size] around each frame; beyond both ends they are as there."""
    before = size // 2
    padding = [(before, size - 1 - before), *[(0, 0)] * (values.ndim - 1)]
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, padding, mode="edge"), size, axis=0)


def _eased(changes: np.ndarray, touches: np.ndarray) -> np.ndarray:
    """Smooth changes [T, 15, 3] of angles; digits that do not touch [T, 5] have those of the nearest frame, fading."""
    frames, filled = np.arange(len(changes)), changes.copy()
    for digit in range(5):
        joints, touching = slice(3 * digit, 3 * digit + 3), np.flatnonzero(touches[:, digit])
        if not len(touching):
            filled[:, joints] = 0
            continue
        nearest = touching[np.abs(frames[:, None] - touching).argmin(1)]
        share = np.clip(1 - np.abs(frames - nearest) / _EASE_FRAMES, 0, 1)
        filled[:, joints] = (share * share * (3 - 2 * share))[:, None, None] * changes[nearest, joints]
    return _smoothed(filled)
