"""Hands that a tracker finds in each picture, joined to hands in space.

Two finds of different pictures are taken for one hand, its landmarks are triangulated, and all other pictures vote: a
find supports the hand as it lies near its projection. The hand with most support keeps its finds; the rest are joined
again to another hand. Chirality in space tells right from left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ...hand.model import HandModel
from ...motion.landmarks.fit import side_errors
from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from ...tracking.crop import region_of_landmarks
from ...tracking.tracker import HandTracker
from ...tracking.weights import TrackerNetworks
from .calibration import LEAST_VIEWS, RigView
from .triangulation import consensus_points, projected, projections, triangulated

_WRIST, _MIDDLE_KNUCKLE = 0, 9
_PALMS_M = (0.04, 0.16)  # from the wrist to the middle knuckle
_GATE = 0.35  # of the hand's size in the picture: the mean error at which a find supports a guess no more
_OWN_GATE = 0.18  # of that size: the same, once hands are known
_NEAR = 0.06  # of that size: landmarks within it are triangulated together
_SAME_FIND = 0.15  # of that size: two finds closer than this are of one hand
_SAME_HAND_M = 0.03
_ROUNDS = 3
_LEAST_PRESENCE = 0.5
_CLEAR_SIDE = 1.3  # ratio of both sides' fit errors from which chirality decides


class Find(NamedTuple):
    """A hand in one picture.

    Attributes:
        view: row of the view.
        px: [21, 2] landmarks.
        right: 0..1, how surely it is a right hand.
    """

    view: int
    px: np.ndarray
    right: float

    @property
    def size_px(self) -> float:
        """The longer side of the box about the landmarks."""
        return float(max(np.ptp(self.px, axis=0).max(), 1.0))


@dataclass(frozen=True)
class AssociatedHand:
    """One hand in space with its finds.

    Attributes:
        side: right or left.
        finds: at most one of each view.
        points: [21, 3] m, world: the landmarks that most views agree on.
    """

    side: Side
    finds: tuple[Find, ...]
    points: np.ndarray

    @property
    def views(self) -> list[int]:
        """Rows of the views that have a find."""
        return [find.view for find in self.finds]


def found_hands(views: Sequence[RigView], networks: TrackerNetworks, most_hands: int = 2) -> list[Find]:
    """Find the hands of every picture by itself; each is looked at twice, the second time from its own landmarks."""
    finds = []
    for row, view in enumerate(views):
        tracker = HandTracker(networks, most_hands)
        at_first = tracker.track(view.rgb)
        finds += [Find(row, hand.px, hand.right) for hand in tracker.track(view.rgb) or at_first]
    return finds


def associated_hands(finds: Sequence[Find], cameras: Sequence[Camera], model: HandModel) -> dict[Side, AssociatedHand]:
    """Join finds to at most one right and one left hand.

    Raises:
        LiveHandError: no hand is found in three views or more that agree.
    """
    matrices, rest, hands = projections(cameras), list(finds), []
    while (own := _best_supported(rest, matrices)) is not None:
        taken = {id(find) for find in own}
        rest = [find for find in rest if id(find) not in taken]
        points = _agreed_points(own, matrices)
        hand = AssociatedHand(_side_of(points, own, model), tuple(own), points)
        is_new = all(np.linalg.norm(hand.points - other.points, axis=1).mean() > _SAME_HAND_M for other in hands)
        if is_new:
            hands.append(hand)
    by_side: dict[Side, AssociatedHand] = {}
    for hand in hands:  # those of most support come first
        by_side.setdefault(hand.side, hand)
    for _ in range(_ROUNDS):
        by_side = _shared_out(by_side, finds, matrices)
    if not by_side:
        count = len({find.view for find in finds})
        raise LiveHandError(
            f"a hand must be seen by at least {LEAST_VIEWS} cameras that agree, got finds in {count} of {len(cameras)} "
            "pictures; check the cameras, or show the hand whole and bare to more of them"
        )
    return by_side


def _shared_out(
    hands: dict[Side, AssociatedHand], finds: Sequence[Find], matrices: np.ndarray
) -> dict[Side, AssociatedHand]:
    """Give every find to the hand that it lies nearest to, one a view, and triangulate anew."""
    px = {side: projected(matrices, hand.points[None])[0] for side, hand in hands.items()}
    pairs: list[tuple[float, Side, int]] = [
        (_distance(px[side][find.view], find), side, index) for side in hands for index, find in enumerate(finds)
    ]
    own: dict[Side, dict[int, Find]] = {side: {} for side in hands}
    taken: set[int] = set()
    for distance, side, index in sorted(pairs):
        find = finds[index]
        if distance < _OWN_GATE and index not in taken and find.view not in own[side]:
            own[side][find.view] = find
            taken.add(index)
    enough: dict[Side, list[Find]] = {
        side: list(views.values()) for side, views in own.items() if len(views) >= LEAST_VIEWS
    }
    return {side: _hand_at(side, mine, matrices) for side, mine in enough.items()}


def with_second_look(
    hands: dict[Side, AssociatedHand], views: Sequence[RigView], networks: TrackerNetworks
) -> dict[Side, AssociatedHand]:
    """Look for each hand where its landmarks are projected to, in views that have no find of it."""
    tracker, matrices = HandTracker(networks), projections([view.camera for view in views])
    completed: dict[Side, AssociatedHand] = {}
    for side, hand in hands.items():
        others = [find for other in hands.values() if other.side != side for find in other.finds]
        more = []
        for row in sorted(set(range(len(views))) - set(hand.views)):
            px = projected(matrices[row], hand.points)[0]
            if not _is_inside(px, views[row].camera):
                continue
            found = tracker.look(views[row].rgb, region_of_landmarks(px))
            find = Find(row, found.px, found.right)
            is_others = any(_distance(find.px, other) < _SAME_FIND for other in others if other.view == row)
            if found.presence >= _LEAST_PRESENCE and _distance(px, find) < _OWN_GATE and not is_others:
                more.append(find)
        completed[side] = _hand_at(side, [*hand.finds, *more], matrices)
    return completed


def _is_inside(px: np.ndarray, camera: Camera) -> bool:
    return bool(((px.mean(0) > 0) & (px.mean(0) < camera.size_px)).all())


def _distance(px: np.ndarray, find: Find) -> float:
    """Measure the mean distance of landmarks from a find's, as a share of its size."""
    return float(np.linalg.norm(px - find.px, axis=-1).mean() / find.size_px)


def _best_supported(finds: Sequence[Find], matrices: np.ndarray) -> list[Find] | None:
    """Choose the finds of the hand with most support; None: no three views agree."""
    best, most = None, 0.0
    for one, other in combinations(finds, 2):
        if one.view == other.view:
            continue
        points = triangulated(matrices[[one.view, other.view]], np.stack([one.px, other.px]), np.ones((2, 21)))
        palm_m = np.linalg.norm(points[_WRIST] - points[_MIDDLE_KNUCKLE])
        if not _PALMS_M[0] < palm_m < _PALMS_M[1]:
            continue
        own, support = _supporters(points, finds, matrices)
        if support > most:
            best, most = own, support
    if best is None:
        return None
    for _ in range(_ROUNDS):
        points = _agreed_points(best, matrices)
        own = _supporters(points, finds, matrices)[0]
        if len(own) < LEAST_VIEWS:
            return None
        best = own
    return best


def _supporters(points: np.ndarray, finds: Sequence[Find], matrices: np.ndarray) -> tuple[list[Find], float]:
    """Find the best find of each view within the gate of points [21, 3], and the support of all."""
    px, depth = projected(matrices, points[None])
    support: dict[int, tuple[float, Find]] = {}
    for find in finds:
        share = 1 - _distance(px[find.view], find) / _GATE
        is_in_front = bool((depth[find.view] > 0).all())
        if share > 0 and is_in_front and share > support.get(find.view, (0.0, find))[0]:
            support[find.view] = share, find
    return [find for _, find in support.values()], sum((share for share, _ in support.values()), 0.0)


def _agreed_points(finds: Sequence[Find], matrices: np.ndarray) -> np.ndarray:
    tolerance_px = np.array([_NEAR * find.size_px for find in finds])
    px = np.stack([find.px for find in finds])
    return consensus_points(matrices[[find.view for find in finds]], px, tolerance_px)[0]


def _hand_at(side: Side, finds: Sequence[Find], matrices: np.ndarray) -> AssociatedHand:
    return AssociatedHand(side, tuple(sorted(finds, key=lambda find: find.view)), _agreed_points(finds, matrices))


def _side_of(points: np.ndarray, finds: Sequence[Find], model: HandModel) -> Side:
    """Tell the side by the fit of both hands in space; where it cannot tell, by what the tracker thinks."""
    try:
        errors = side_errors(points[None], model)
    except LiveHandError:  # landmarks that are no hand's size
        errors = dict.fromkeys(SIDES, 1.0)
    if max(errors.values()) > _CLEAR_SIDE * min(errors.values()):
        return min(SIDES, key=errors.__getitem__)
    return "right" if np.mean([find.right for find in finds]) > 0.5 else "left"
