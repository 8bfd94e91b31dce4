"""The gate for a hand that comes frame by frame: its last seconds are checked as a motion's are, once a second."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from ...hand.model import HandModel
from ...records.shot import HandPose
from ...records.side import Side
from ..gate import motion_doubts
from ..motion import motion_from_poses
from .camera_fit import at_nodes
from .initial_pose import MirrorSigns, mirror_signs
from .skeleton import HandSkeleton

_WINDOW_S, _EVERY_S = 3.0, 1.0
_MOST_FRAMES = 360  # of the window
_WRONG_SHARE = 0.2  # of frames whose landmarks fit no hand, from which the hand is doubted
_MIRROR = np.array([-1.0, 1, 1])


def lost_doubt(share: float) -> str | None:
    """Word a share of frames whose landmarks fit no hand; None: it is small."""
    return f"the hand was not where it seemed in {100 * share:.0f} % of the frames" if share > _WRONG_SHARE else None


def mirror_doubt(signs: MirrorSigns) -> str | None:
    """Word what of a tracker's hand is as if mirrored; None: nothing."""
    if signs.backwards_rad:
        degrees = np.rad2deg(signs.backwards_rad)
        return f"the fingers are seen {degrees:.0f} degrees bent backwards, as in a mirrored picture"
    return "the thumb is seen behind the palm, as in a mirrored picture" if signs.thumb_behind else None


class _GatedFrame(NamedTuple):
    time_s: float
    world: np.ndarray | None
    pose: HandPose | None


class LiveGate:
    """What speaks against the hand that a camera shows.

    Attributes:
        doubts: of the last seconds; empty: nothing.
    """

    def __init__(self, model: HandModel, side: Side):
        self.doubts: tuple[str, ...] = ()
        self._model, self._side, self._skeleton = model.for_side(side), side, HandSkeleton.of(model)
        self._seen: deque[_GatedFrame] = deque(maxlen=_MOST_FRAMES)
        self._checked_s: float | None = None

    def saw(self, time_s: float, world: np.ndarray, pose: HandPose | None) -> None:
        """Take in a frame: its world landmarks [21, 3] m, and the pose that was found; None: they fit no hand."""
        self._take(_GatedFrame(time_s, world, pose), None)

    def refused(self, time_s: float, why: str) -> None:
        """Take in a frame whose landmarks were refused."""
        self._take(_GatedFrame(time_s, None, None), why)

    def _take(self, seen: _GatedFrame, why: str | None) -> None:
        self._seen.append(seen)
        while seen.time_s - self._seen[0].time_s > _WINDOW_S:
            self._seen.popleft()
        if self._checked_s is None:
            self._checked_s = seen.time_s
        if seen.time_s - self._checked_s >= _EVERY_S:
            self._checked_s = seen.time_s
            found = [
                why,
                lost_doubt(sum(one.pose is None for one in self._seen) / len(self._seen)),
                *self._pose_doubts(),
            ]
            self.doubts = tuple(doubt for doubt in found if doubt)

    def _pose_doubts(self) -> list[str | None]:
        worlds = [one.world for one in self._seen if one.world is not None]
        known = [(one.time_s, one.pose) for one in self._seen if one.pose is not None]
        if not known:
            return []
        nodes = at_nodes(np.stack(worlds)) * (_MIRROR if self._side == "left" else 1)
        times = np.array([time_s for time_s, _ in known])
        fps = 1 / float(np.median(np.diff(times))) if len(times) > 1 else None
        motion = motion_from_poses([pose for _, pose in known], fps)
        return [mirror_doubt(mirror_signs(nodes, self._skeleton)), *motion_doubts(self._model, motion)]
