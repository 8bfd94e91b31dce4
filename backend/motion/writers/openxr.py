"""OpenXR's 26 joints of a hand as JSON: positions in metres, Y up, and orientations as quaternions (x, y, z, w).

A joint's -Z points along its bone, its +Y out of the hand's back, as OpenXR and Quest have them. Each hand's `rest`
tells the same of its flat pose, so that its motion can be retargeted exactly, twist included.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...geometry.rotation import continuous, matrix_to_quaternion
from ...hand.bones import rest_bones
from ...system.files import replacing
from ..formats.openxr import JOINTS, NAME, full_name
from ..motion import HandMotion
from .posed_joints import JOINT_NODES, PosedJoints, pose_joints
from .take import Take, TakenHand
from .writer import WriteOptions, Writer

_FINGERS = ("THUMB", "INDEX", "MIDDLE", "RING", "LITTLE")
_METACARPAL = 0.28  # of the way from the wrist to the knuckle, where a metacarpal begins
_TO_XR = np.array([[-1.0, 0, 0], [0, 0, -1.0], [0, -1.0, 0]])  # columns X, Y, Z of a joint in the frame of our bone
_RADII_M = {"PALM": 0.02, "WRIST": 0.02, "METACARPAL": 0.012, "PROXIMAL": 0.01, "INTERMEDIATE": 0.009, "DISTAL": 0.008}
_TIP_RADIUS_M = 0.006
_MIDDLE_KNUCKLE = 5  # among the 21 nodes
_DECIMALS_M, _DECIMALS = 7, 9


def _write(take: Take, path: Path, options: WriteOptions) -> tuple[str, ...]:
    hands = {hand.side: _JointPoses.of(hand) for hand in take.hands}
    content = {
        "format": NAME,
        "fps": take.fps,
        "axes": "y_up",
        "unit": "m",
        "hands": {hand.side: _about(hand) for hand in take.hands},
        "frames": [
            {"time": float(time_s)}
            | {hand.side: hands[hand.side].at(number - hand.first) for hand in take.hands if number in hand.frames}
            for number, time_s in enumerate(take.times_s)
        ],
    }
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, separators=(",", ":")), encoding="utf-8")
    return ()


def _about(hand: TakenHand) -> dict[str, Any]:
    """Describe a hand: its shape and its rest pose, in the template's frame."""
    beta = hand.motion.betas.mean(0)
    still = HandMotion(np.zeros((1, 16, 3)), beta, np.zeros((1, 3)), side=hand.side)
    rest = _JointPoses.of_motion(hand, still)
    return {"beta": beta.tolist(), "scale": hand.scale, "rest": rest.at(0)}


class _JointPoses:
    """The 26 joints of a hand in T frames, by name: positions [T, 3] m and orientations [T, 4] (x, y, z, w)."""

    def __init__(self, positions: dict[str, np.ndarray], rotations: dict[str, np.ndarray], scale: float):
        self._positions = {name: place.round(_DECIMALS_M) for name, place in positions.items()}
        self._orientations = {
            name: continuous(matrix_to_quaternion(rotation))[:, [1, 2, 3, 0]].round(_DECIMALS)
            for name, rotation in rotations.items()
        }
        self._scale = scale

    @classmethod
    def of(cls, hand: TakenHand) -> _JointPoses:
        return cls.of_motion(hand, hand.motion_in("y_up"))

    @classmethod
    def of_motion(cls, hand: TakenHand, motion: HandMotion) -> _JointPoses:
        """Pose the joints as a motion in any space has them."""
        posed = pose_joints(motion, hand.own_model, hand.scale)
        axes = posed.rotations @ (rest_bones(hand.own_model).frames @ _TO_XR)
        positions, rotations = _positions(posed, axes)
        return cls(positions, rotations, hand.scale)

    def at(self, index: int) -> dict[str, Any]:
        """Return the joints of one frame, by OpenXR's names."""
        return {
            full_name(name): {
                "position": self._positions[name][index].tolist(),
                "orientation": self._orientations[name][index].tolist(),
                "radius": round(self._scale * _radius_m(name), _DECIMALS_M),
            }
            for name in self._positions
        }


def _positions(posed: PosedJoints, axes: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Place and turn all joints, those included that MANO has not; axes [T, 16, 3, 3] are of those that it has."""
    nodes, wrist = posed.nodes, posed.nodes[:, 0]
    positions = {"PALM": (wrist + nodes[:, _MIDDLE_KNUCKLE]) / 2}
    rotations = {"PALM": axes[:, 0]}
    for name, joint in JOINTS.items():
        positions[name], rotations[name] = nodes[:, JOINT_NODES[joint]], axes[:, joint]
    for finger in _FINGERS:
        last = JOINTS[f"{finger}_DISTAL"]
        positions[f"{finger}_TIP"], rotations[f"{finger}_TIP"] = nodes[:, JOINT_NODES[last] + 1], axes[:, last]
        if finger != "THUMB":
            reach = positions[f"{finger}_PROXIMAL"] - wrist
            positions[f"{finger}_METACARPAL"] = wrist + _METACARPAL * reach
            rotations[f"{finger}_METACARPAL"] = _pointing(axes[:, 0], reach)
    return positions, rotations


def _pointing(axes: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Turn axes [T, 3, 3] to a joint whose -Z points along a bone [T, 3], its +Y staying as near as it can."""
    z = -along / np.linalg.norm(along, axis=-1, keepdims=True)
    x = np.cross(axes[..., 1], z)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], -1)


def _radius_m(name: str) -> float:
    return _RADII_M.get(name.rpartition("_")[2], _TIP_RADIUS_M)


OPENXR = Writer("openxr", "OpenXR joints", (".json",), _write)
