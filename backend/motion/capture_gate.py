"""The gate for poses that come in with images: a capture's poses and, through its cameras, their place and unit."""

from __future__ import annotations

import numpy as np

from ..capture.capture import Capture
from ..capture.check import hand_box
from ..hand.model import HandModel
from ..records.shot import HandPose
from ..records.side import SIDES
from .gate import mean_doubt, motion_doubts, unordered_doubts
from .motion import FPS_RANGE, HandMotion, motion_from_poses

_VIEWS = 200  # that are looked at, evenly chosen
_SHARE_UNSEEN = 0.5  # of images that should show the hand and do not, from which they are doubted


def capture_doubt(capture: Capture, hand: HandModel, times_s: np.ndarray | None = None) -> str | None:
    """Word what speaks against a capture's poses; None: nothing.

    Args:
        capture: of any source.
        hand: its hand model, or any in MANO's format, which does not tell what images show.
        times_s: [P] of the poses, if they are known to follow each other.
    """
    of_side = {side: [pose for pose in capture.poses if pose.side == side] for side in SIDES}
    found = []
    for side, poses in of_side.items():
        if poses:
            whose = "" if len(poses) == len(capture.poses) else f"the {side} hand: "
            found += [whose + doubt for doubt in _pose_doubts(poses, hand, times_s)]
    found += _unseen(capture, hand) if capture.hand_sha256 == hand.sha256 else []
    return "; ".join(found) or None


def imported_doubt(
    capture: Capture, hand: HandModel, hands_mean: np.ndarray | None, times_s: np.ndarray | None = None
) -> str | None:
    """Word what speaks against the poses that an importer has read; None: nothing.

    Args:
        capture: as it was imported.
        hand: its hand model.
        hands_mean: [15, 3] rad, which was added to the fingers; None: they were said to be absolute.
        times_s: [P] of the poses, if they are known.
    """
    fingers = np.array([pose.theta[1:].ravel() for pose in capture.poses])
    added = None if hands_mean is None else hands_mean.ravel()
    mean = mean_doubt(fingers if added is None else fingers - added, added is None, added)
    return "; ".join(filter(None, [mean, capture_doubt(capture, hand, times_s)])) or None


def _pose_doubts(poses: list[HandPose], hand: HandModel, times_s: np.ndarray | None) -> list[str]:
    motion = motion_from_poses(poses)
    if times_s is None or len(times_s) != len(motion) or len(motion) < 2:
        return unordered_doubts(hand, motion)
    order = np.argsort(times_s, kind="stable")
    step_s = float(np.median(np.diff(times_s[order])))
    fps = 1 / step_s if step_s > 0 else FPS_RANGE[1]
    return motion_doubts(hand, _reordered(motion, order, float(np.clip(fps, *FPS_RANGE))))


def _reordered(motion: HandMotion, order: np.ndarray, fps: float) -> HandMotion:
    betas, forearms = motion.betas[order], motion.forearms[order]
    return HandMotion(motion.theta[order], betas, motion.transl[order], fps, motion.side, forearms)


def _unseen(capture: Capture, hand: HandModel) -> list[str]:
    """Word how many images should show the hand and do not, by pose and camera: axes, unit or frame may be another."""
    from ..hand.lbs import posed_vertices  # with torch, which readers of files can do without

    step = -(-len(capture.views) // _VIEWS)
    views = capture.views[:: max(1, step)]
    posed: dict[int, np.ndarray] = {}
    unseen = 0
    for view in views:
        if view.pose_index not in posed:
            pose = capture.poses[view.pose_index]
            posed[view.pose_index] = posed_vertices(hand.for_side(pose.side), pose)
        unseen += hand_box(posed[view.pose_index], view.camera) is None
    if unseen <= _SHARE_UNSEEN * len(views):
        return []
    return [
        f"by pose and camera {unseen} of {len(views)} images do not show the hand: the unit of the poses, the world's "
        "axes or the cameras' may be others"
    ]
