"""The gate that every motion passes, whatever its road: what speaks against it, in words with joints and degrees.

Limits are wide enough for any hand, so a pose beyond them was misread, mistracked, or is meant for something else.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from ..geometry.rotation import axis_angle_to_matrix
from ..hand.bones import rest_forearm
from ..hand.gestures import FingerAxes, angles_of
from ..hand.joint_axes import anatomical_axes
from ..hand.joint_limits import FREE, LIMITS
from ..hand.model import JOINT_NAMES, MIRROR_AXIS_ANGLE, HandModel
from ..hand.model_file import load_default_hand
from ..records.side import Side
from .motion import HandMotion
from .spaces import rest_wrists

_HINGE_RAD = np.deg2rad(30.0)  # of the angles that are not free: sideways and about the bone
_BEYOND_RAD = np.deg2rad(10.0)  # beyond the limits, from which no hand can
_SLIGHT_RAD = np.deg2rad(1.0)  # beyond the limits, from which a joint is named: less is rounding
_ARM_RAD = np.deg2rad(90.0)  # between the forearm and the hand's own direction
_BACKWARDS_RAD = np.deg2rad(10.0)  # fingers on average, in the frames that show it most
_LESS, _LITTLE_RAD = 0.5, np.deg2rad(1.0)  # of the excess beyond the limits, at which another reading is better
_EXTREME_FRAMES = 5  # percentile, from which frames show it most
_TURN_RAD = np.deg2rad(75.0)  # of a joint from a frame to the next
_MOST_JUMPS = 0.1  # share of frames; where more jump, they do not follow each other
_FASTEST_M_S, _FARTHEST_M = 30.0, 50.0  # of a wrist
# Finger angles whose mean over all frames has an RMS below this probably count from MANO's mean pose: that of natural
# absolute poses is about 0.3.
_NEAR_ZERO_RAD = 0.06
_LEAST_CORRELATION = 0.6  # of the mean with MANO's mean pose, above which angles are probably absolute
_LEAST_FRAMES_OF_MEAN = 10
_USUAL_FPS = 30.0
_LEAST_FRAMES = 8  # of a motion whose frames should follow each other
_LARGEST_BETA = 6.0
_FULL_TURN_RAD = 2 * np.pi + 0.1


Counted = Literal["frame", "pose"]
_InFrames = Callable[[np.ndarray], str]


class JointBend(NamedTuple):
    """What finger joints do in T frames, rad, in MANO's order of joints.

    Attributes:
        angles: [T, 15, 3] flexion, abduction and twist.
        excess: [T, 15] how far the worst of them is beyond its limits.
    """

    angles: np.ndarray
    excess: np.ndarray

    @classmethod
    def of(cls, model: HandModel, theta: np.ndarray, side: Side | None = None) -> JointBend:
        """Measure poses theta [T, 16, 3] of a side; None: the model's."""
        right = theta if (side or model.side) == "right" else theta * MIRROR_AXIS_ANGLE
        axes = np.pad(anatomical_axes(model.for_side("right")), ((1, 0), (0, 0), (0, 0)))
        angles = angles_of(right, FingerAxes(*axes.swapaxes(0, 1)))
        excess = np.maximum(_LIMITS_RAD[..., 0] - angles, angles - _LIMITS_RAD[..., 1]).max(-1).clip(min=0)
        return cls(angles, excess)

    @property
    def backwards_rad(self) -> float:
        """How far the four fingers bend backwards on average, in the frames that show it most; 0: they close more."""
        return backwards_rad(self.angles[:, :12, 0].mean(1), _BACKWARDS_RAD)


def backwards_rad(bend: np.ndarray, least_rad: float) -> float:
    """Measure how far fingers bent by [T] on average do so backwards, in the frames that show it most.

    0: by less than the least, or they close more.
    """
    least, most = np.percentile(bend, [_EXTREME_FRAMES, 100 - _EXTREME_FRAMES])
    return float(-least) if -least > max(most, least_rad) else 0.0


def excess_rad(model: HandModel, theta: np.ndarray) -> np.ndarray:
    """Compute [T, 15] how far each finger joint of poses theta [T, 16, 3] is beyond its limits, by its worst angle."""
    return JointBend.of(model, theta).excess


def bends_backwards(theta: np.ndarray, side: Side) -> bool:
    """Tell whether poses theta [T, 16, 3] of a side bend the fingers backwards, and are natural as the other side's."""
    if not len(theta):
        return False
    hand = load_default_hand()
    own, other = (JointBend.of(hand, turns, side) for turns in (theta, theta * MIRROR_AXIS_ANGLE))
    is_better = other.excess.mean() <= _LESS * own.excess.mean() + _LITTLE_RAD
    return bool(own.backwards_rad > 0 and is_better)


def motion_doubts(model: HandModel, motion: HandMotion) -> list[str]:
    """List what speaks against a motion that comes in from outside; empty: nothing.

    Args:
        model: any hand in MANO's format.
        motion: absolute, m.
    """
    model = model.for_side(motion.side)
    place = _far(model, motion) or _fast(model, motion)
    found = [*pose_doubts(model, motion), _jumps(motion), place, _shape(motion)]
    return [doubt for doubt in found if doubt]


def unordered_doubts(model: HandModel, motion: HandMotion) -> list[str]:
    """List what speaks against poses that do not follow each other; empty: nothing."""
    model = model.for_side(motion.side)
    found = [*pose_doubts(model, motion, "pose"), _far(model, motion), _shape(motion)]
    return [doubt for doubt in found if doubt]


def mean_doubt(fingers: np.ndarray, has_mean_added: bool, mean: np.ndarray | None) -> str | None:
    """Word why finger angles [T, 45], rad, are probably not absolute, or are, as is said; None: they agree with it.

    Args:
        fingers: as they were found.
        has_mean_added: whether they are said to be absolute.
        mean: [45] MANO's mean pose for the side of the angles; None: not known.
    """
    if len(fingers) < _LEAST_FRAMES_OF_MEAN:
        return None
    found = fingers.mean(0)
    if has_mean_added and np.sqrt((found**2).mean()) < _NEAR_ZERO_RAD:
        return "the mean of all frames is a flat hand: the angles may count from MANO's mean"
    if not has_mean_added and mean is not None and np.corrcoef(found, mean)[0, 1] > _LEAST_CORRELATION:
        return "the mean of all frames is like MANO's mean: the angles may be absolute already"
    return None


def pose_doubts(model: HandModel, motion: HandMotion, counted: Counted | None = "frame") -> list[str]:
    """List what speaks against the poses of a motion, in whatever order; empty: nothing.

    Args:
        model: any hand in MANO's format.
        motion: absolute, m.
        counted: as what the poses at fault are counted; None: they are not.
    """
    model, in_frames = model.for_side(motion.side), partial(_in_frames, counted) if counted else _nowhere
    found = [_angles_in_degrees(motion.theta), *_bend_doubts(model, motion, in_frames), _arm(model, motion, in_frames)]
    return [doubt for doubt in found if doubt]


def _bend_doubts(model: HandModel, motion: HandMotion, in_frames: _InFrames) -> list[str]:
    bend = JointBend.of(model, motion.theta)
    found = []
    if bend.backwards_rad:
        found.append(
            f"the fingers bend {np.rad2deg(bend.backwards_rad):.0f} degrees backwards on average, as a mirrored hand's "
            "or the other hand's would"
        )
    worst = bend.excess.max(0)
    for least, is_named, rule in (
        (_BEYOND_RAD, worst > _BEYOND_RAD, "what a hand can"),
        (_SLIGHT_RAD, (worst > _SLIGHT_RAD) & (worst <= _BEYOND_RAD), "a hand's usual limits"),
    ):
        if is_named.any():
            names = [name for name, named in zip(JOINT_NAMES[1:], is_named, strict=True) if named]
            found.append(
                f"{', '.join(names)} bend up to {np.rad2deg(worst[is_named].max()):.0f} degrees beyond {rule}"
                f"{in_frames((bend.excess[:, is_named] > least).any(1))}"
            )
    return found


def _arm(model: HandModel, motion: HandMotion, in_frames: _InFrames) -> str | None:
    """Word a forearm that lies along the hand as none can."""
    if not model.has_arm:
        return None
    elbow = -rest_forearm(model).frame[:, 1]
    cosine = axis_angle_to_matrix(motion.forearms) @ elbow @ elbow
    bent = np.arccos(np.clip(cosine, -1, 1))
    if bent.max() <= _ARM_RAD:
        return None
    degrees = np.rad2deg(bent.max())
    return f"the wrist bends by up to {degrees:.0f} degrees against the forearm{in_frames(bent > _ARM_RAD)}"


def _in_frames(counted: Counted, is_in: np.ndarray) -> str:
    if is_in.all():
        return ""
    first = int(np.argmax(is_in))
    return f", in {is_in.sum()} of {len(is_in)} {counted}s, first in its {counted} {first + 1}"


def _nowhere(_is_in: np.ndarray) -> str:
    return ""


def _jumps(motion: HandMotion) -> str | None:
    """Word where joints turn from a frame to the next as none can."""
    if len(motion) < _LEAST_FRAMES:
        return None
    turns = axis_angle_to_matrix(motion.theta)
    cosine = (np.einsum("tjab,tjab->tj", turns[1:], turns[:-1]) - 1) / 2
    turned = np.arccos(np.clip(cosine, -1, 1))
    limit = min(np.pi * 0.9, _TURN_RAD * max(1.0, _USUAL_FPS / (motion.fps or _USUAL_FPS)))
    is_jump = (turned > limit).any(1)
    if not is_jump.any():
        return None
    if is_jump.sum() > max(1, _MOST_JUMPS * len(is_jump)):
        return f"{is_jump.sum()} of {len(motion)} frames do not follow the one before: they may be single pictures"
    step = int(np.argmax(turned.max(1)))
    joint = int(np.argmax(turned[step]))
    return (
        f"{JOINT_NAMES[joint]} turns by {np.rad2deg(turned[step, joint]):.0f} degrees from its frame {step + 1} to the "
        f"next, one of {is_jump.sum()} such jumps"
    )


def _far(model: HandModel, motion: HandMotion) -> str | None:
    """Word a wrist that is farther away than any: the unit may be another."""
    wrists = rest_wrists(model, motion.betas) + motion.transl
    away_m = float(np.linalg.norm(wrists, axis=-1).max())
    return f"the wrist is up to {away_m:.3g} m away: the unit may be another" if away_m > _FARTHEST_M else None


def _fast(model: HandModel, motion: HandMotion) -> str | None:
    """Word a wrist that is faster than any: the unit or the rate may be another."""
    if len(motion) < 2:
        return None
    wrists = rest_wrists(model, motion.betas) + motion.transl
    speed = np.linalg.norm(np.diff(wrists, axis=0), axis=-1) * (motion.fps or _USUAL_FPS)
    if np.median(speed) > _FASTEST_M_S:
        return f"the wrist moves at {np.median(speed):.3g} m/s: the unit or the rate may be another"
    return None


def _shape(motion: HandMotion) -> str | None:
    largest = float(np.abs(motion.beta).max(initial=0))
    return f"a shape of {largest:.3g} standard deviations is no hand's" if largest > _LARGEST_BETA else None


def _angles_in_degrees(theta: np.ndarray) -> str | None:
    largest = float(np.linalg.norm(theta[:, 1:], axis=-1).max(initial=0))
    return f"angles of up to {largest:.3g} rad: they may be in degrees" if largest > _FULL_TURN_RAD else None


def _limits_rad() -> np.ndarray:
    """Return [15, 3, 2] smallest and largest flexion, abduction and twist."""
    limits = np.tile([-_HINGE_RAD, _HINGE_RAD], (45, 1))
    limits[FREE] = LIMITS
    return limits.reshape(15, 3, 2)


_LIMITS_RAD = _limits_rad()
