"""*Grasp*: closes a hand on things until it touches, and keeps the animator's pose as far as contact allows.

Digits bend towards a fist until they touch (`closing`); those that do not are drawn to the surface if it is near; then
joints settle (`settling`), within the usual limits or as far beyond them as they were given. The wrist stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..geometry.rotation import axis_angle_to_matrix
from ..hand.bones import FINGERS
from ..hand.gestures import angles_of, theta_of
from ..hand.joint_limits import FREE
from ..hand.model import MANO_FINGERS, HandModel
from ..records.errors import LiveHandError
from ..records.shot import HandPose
from .closing import Closer
from .contact_hand import PALM, ContactHand
from .own_contacts import OwnContactSearch
from .placed_solids import PlacedSolid, Solids
from .point_distances import PointDistances
from .settling import Settler, Settling

TOUCH_M = 0.001
"""A digit touches within this."""
DEEPEST_M = 0.001
"""The palm may lie in a thing as deep as this."""
_ROUNDING_M = 1e-6


@dataclass(frozen=True)
class GraspOptions:
    """How a hand grasps.

    Attributes:
        fingers: which may move.
        press_m: how deep pads press into a thing before they flatten, at most `DEEPEST_M`.
        reach_m: how far a digit that closing brought to no contact may be drawn; 0: such a digit keeps its pose.
        moves_wrist: move a hand whose palm is inside, as little as brings it out.
    """

    fingers: Sequence[str] = FINGERS
    press_m: float = 0.0006
    reach_m: float = 0.015
    moves_wrist: bool = False


@dataclass(frozen=True)
class Grasp:
    """A hand that touches.

    Attributes:
        pose: its parameters.
        gaps_m: finger -> distance of its palmar side to the surface, negative inside.
        touches: the fingers that touch, within `TOUCH_M`.
        inside: the fingers that could not be brought out of a thing: a part of them is deeper than `DEEPEST_M`.
        deepest_m: how deep the deepest of its points is in a thing; 0: none is.
        own_deepest_m: how deep digits pass through each other.
    """

    pose: HandPose
    gaps_m: dict[str, float]
    touches: tuple[str, ...]
    inside: tuple[str, ...]
    deepest_m: float
    own_deepest_m: float


class NothingInReach(LiveHandError):
    """No finger reaches a thing."""


class Grasper:
    """Grasps with one hand of one shape, many times."""

    def __init__(self, model: HandModel, beta: np.ndarray):
        """Prepare a model of either side in the shape beta [10]."""
        self._hand = ContactHand.of(model, beta)
        self._own = OwnContactSearch(self._hand)

    def grasp(self, pose: HandPose, things: Sequence[PlacedSolid], options: GraspOptions) -> Grasp:
        """Close a hand of this shape on things.

        Args:
            pose: of either side.
            things: in the hand's own space.
            options: how.

        Raises:
            LiveHandError: no finger may move, the palm is inside a thing, or no finger reaches one.
        """
        _check(options)
        if pose.side == "left":
            found = self.grasp(pose.mirrored(), [one.mirrored() for one in things], options)
            return replace(found, pose=found.pose.mirrored())
        solids = Solids(things)
        pose = self._without_palm_inside(pose, solids, options.moves_wrist)
        local = self._in_wrist(pose, solids)
        angles = self._closed(self.angles(pose), local, options)
        found = self.measured(replace(pose, theta=self._theta(pose, angles)), things)
        if not found.touches:
            finger = min(found.gaps_m, key=lambda name: found.gaps_m[name])
            raise NothingInReach(
                f"a finger must reach {solids.names}; the nearest, the {finger}, ends "
                f"{1000 * found.gaps_m[finger]:.0f} mm away: bring the hand nearer, or turn the palm to it"
            )
        return found

    def measured(self, pose: HandPose, things: Sequence[PlacedSolid]) -> Grasp:
        """Measure how a pose of either side touches things in the hand's own space."""
        if pose.side == "left":
            found = self.measured(pose.mirrored(), [one.mirrored() for one in things])
            return replace(found, pose=pose)
        hand, local = self._hand, self._in_wrist(pose, Solids(things))
        vertices = hand.posed(self.angles(pose)[None])[0]
        distances, own = PointDistances(hand, local), self._own.contacts(vertices, 0.0)
        distances.move(vertices)
        pads = [np.flatnonzero((hand.digit == digit) & hand.is_palmar) for digit in range(5)]
        nearest = distances.signed_m[distances.nearest(pads)]
        gaps = {finger: float(gap) for finger, gap in zip(MANO_FINGERS, nearest, strict=True)}
        touches = tuple(finger for finger in FINGERS if abs(gaps[finger]) <= TOUCH_M)
        deep = distances.below(0.0, np.arange(len(hand.digit)))
        depth_m = -distances.signed_m[deep]
        digits = set(hand.digit[deep[depth_m > DEEPEST_M]].tolist())
        inside = tuple(finger for finger in FINGERS if MANO_FINGERS.index(finger) in digits)
        own_m = max(0.0, float(-own.gap_m.min(initial=0.0)))
        return Grasp(pose, gaps, touches, inside, float(depth_m.max(initial=0.0)), own_m)

    def angles(self, pose: HandPose) -> np.ndarray:
        """Compute joint angles [15, 3] rad of a right pose."""
        return angles_of(pose.theta, self._hand.axes)

    @staticmethod
    def touching_digits(grasp: Grasp) -> np.ndarray:
        """Return [5] which digits touch, in MANO's order."""
        return np.array([finger in grasp.touches for finger in MANO_FINGERS])

    def settled(
        self,
        pose: HandPose,
        things: Sequence[PlacedSolid],
        angles: np.ndarray,
        touches: np.ndarray,
        options: GraspOptions,
    ) -> HandPose:
        """Give a right pose other angles [15, 3] rad, and settle them so that digits [5] touch."""
        moves = np.array([finger in options.fingers for finger in MANO_FINGERS])
        distances = PointDistances(self._hand, self._in_wrist(pose, Solids(things)))
        wanted = Settling(angles, touches & moves, options.press_m, *self._bounds(self.angles(pose)), moves)
        found = Settler(self._hand, distances, self._own).settled(angles, wanted)
        return replace(pose, theta=self._theta(pose, found))

    def _closed(self, given: np.ndarray, solids: Solids, options: GraspOptions) -> np.ndarray:
        hand = self._hand
        moves = np.array([finger in options.fingers for finger in MANO_FINGERS])
        distances = PointDistances(hand, solids)
        closing = Closer(hand, distances, self._own).closed(given, moves, options.press_m)
        settler = Settler(hand, distances, self._own)
        touches = closing.touches & moves
        angles = np.where(np.repeat(touches | ~moves, 3)[:, None], closing.angles, given)
        wanted = Settling(angles, touches, options.press_m, *self._bounds(given), moves)
        angles = settler.settled(angles, wanted)
        if options.reach_m > 0 and not touches[moves].all():
            angles = self._drawn(settler, angles, wanted, options.reach_m)
        return angles

    def _drawn(self, settler: Settler, angles: np.ndarray, wanted: Settling, reach_m: float) -> np.ndarray:
        """Draw the digits that do not touch to surfaces within reach; those that do not arrive stay where they were."""
        gaps = settler.gaps_m(angles)
        tries = wanted.moves & ~wanted.presses & (gaps < reach_m)
        if not tries.any():
            return angles
        drawn = settler.settled(angles, replace(wanted, presses=wanted.presses | tries))
        if settler.has_deeper(drawn, DEEPEST_M) and not settler.has_deeper(angles, DEEPEST_M):
            return angles
        arrived = tries & (settler.gaps_m(drawn) <= TOUCH_M)
        stays = np.repeat(tries & ~arrived, 3)[:, None]
        kept = np.where(stays, angles, drawn)
        presses = wanted.presses | arrived
        return settler.settled(kept, replace(wanted, reference=kept, presses=presses)) if stays.any() else drawn

    def _bounds(self, given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the free angles' limits [21], widened to the angles given."""
        flat, limits = given.ravel()[FREE], self._hand.limits_rad.swapaxes(0, 1).reshape(2, 45)[:, FREE]
        return np.minimum(limits[0], flat), np.maximum(limits[1], flat)

    def _in_wrist(self, pose: HandPose, solids: Solids) -> Solids:
        """Move solids from a right hand's space to that of its unturned wrist."""
        rotation, wrist = axis_angle_to_matrix(pose.theta[0]), self._hand.rest_joints[0]
        return solids.moved(rotation.T, wrist - rotation.T @ (wrist + pose.transl))

    def _theta(self, pose: HandPose, angles: np.ndarray) -> np.ndarray:
        return theta_of(np.rad2deg(angles), self._hand.axes, pose.theta[0])

    def _without_palm_inside(self, pose: HandPose, solids: Solids, moves_wrist: bool) -> HandPose:
        hand = self._hand
        vertices = hand.posed(self.angles(pose)[None])[0]
        palm = hand.points(vertices)[hand.digit == PALM]
        local = self._in_wrist(pose, solids)
        depth_m = -float(local.distances(palm).signed_m.min())
        if depth_m <= DEEPEST_M:
            return pose
        if not moves_wrist:
            raise LiveHandError(
                f"the palm must not be inside {solids.names}, it is {1000 * depth_m:.1f} mm deep; move the hand out, "
                "or turn on Move Wrist"
            )
        way = _way_out(palm, local)
        return replace(pose, transl=pose.transl + axis_angle_to_matrix(pose.theta[0]) @ way)


def _check(options: GraspOptions) -> None:
    unknown = [finger for finger in options.fingers if finger not in FINGERS]
    if unknown or not options.fingers:
        raise LiveHandError(f"fingers must be some of {', '.join(FINGERS)}, got {', '.join(unknown) or 'none'}")
    if not 0 <= options.press_m <= DEEPEST_M:
        raise LiveHandError(f"the press must be 0 to {1000 * DEEPEST_M:.0f} mm, got {1000 * options.press_m:.2f} mm")


def _way_out(points: np.ndarray, solids: Solids) -> np.ndarray:
    """Find a short way [3] m by which points [P, 3] leave solids, but for what flesh yields."""
    way = np.zeros(3)
    for _ in range(100):
        found = solids.distances(points + way)
        deepest = found.signed_m.argmin()
        depth_m = -found.signed_m[deepest] - DEEPEST_M / 2
        if depth_m <= _ROUNDING_M:
            return way
        way = way + depth_m * found.outward[deepest]
    raise LiveHandError(f"the palm must fit beside {solids.names}, and no short way leads out of it; move the hand out")
