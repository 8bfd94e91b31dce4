"""Hand gestures as joint angles, and random natural poses mixed from them.

Angles are in degrees about anatomical axes of the rest pose: flexion bends a finger towards the palm, abduction rotates
it towards the thumb, twist rotates it about its own bone. `FingerAxes` converts them to MANO's theta (axis-angle, rad).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

import numpy as np

from ..geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from .model import MANO_FINGERS

_ROW = {name: 3 * k for k, name in enumerate(MANO_FINGERS)}  # first joint of each finger among the 15

# The tests' type checker does not accept an int as a float.
Degrees = float | int
Flexion = dict[str, tuple[Degrees, Degrees, Degrees]]


@dataclass(frozen=True)
class FingerAxes:
    """Anatomical axes of the 16 joints in the template's frame: unit vectors [16, 3], zero for the wrist."""

    flexion: np.ndarray
    dorsal: np.ndarray
    bone: np.ndarray

    @classmethod
    def of_default_hand(cls) -> FingerAxes:
        """Read the axes in the built-in hand's file."""
        with np.load(Path(str(resources.files(str(__package__)) / "hand_with_arm.npz"))) as arrays:
            return cls(arrays["flex_axis"], arrays["dorsal_dir"], arrays["bone_dir"])


@dataclass(frozen=True)
class Gesture:
    """Joint angles of a hand, degrees; fingers that are not named stay at rest.

    Attributes:
        flexion: of the four fingers' MCP, PIP and DIP joints.
        abduction: of the four fingers' MCP joints.
        thumb: (flexion, abduction, twist) of the CMC, MCP and IP joints.
    """

    flexion: Flexion = field(default_factory=dict)
    abduction: dict[str, Degrees] = field(default_factory=dict)
    thumb: tuple[tuple[Degrees, Degrees, Degrees], ...] = ((0, 0, 0), (0, 0, 0), (0, 0, 0))

    def angles_deg(self) -> np.ndarray:
        """Compute [15, 3] flexion, abduction, twist of joints 1..15."""
        angles = np.zeros((15, 3))
        for finger, flexions in self.flexion.items():
            angles[_ROW[finger] : _ROW[finger] + 3, 0] = flexions
        for finger, abduction in self.abduction.items():
            angles[_ROW[finger], 1] = abduction
        angles[_ROW["thumb"] :] = self.thumb
        return angles


def _fingers(mcp: Degrees, pip: Degrees, dip: Degrees) -> Flexion:
    return {name: (mcp, pip, dip) for name in MANO_FINGERS[:4]}


GESTURES: dict[str, Gesture] = {
    "rest": Gesture(),
    "open": Gesture(
        _fingers(-12, -8, -4),
        {"index": 6, "middle": 1, "ring": -4, "pinky": -8},
        ((-10, 0, 0), (-6, 0, 0), (-10, 0, 0)),
    ),
    "spread": Gesture(
        _fingers(-14, -9, -5),
        {"index": 9, "middle": 1, "ring": -7, "pinky": -12},
        ((-14, 0, 0), (-8, 0, 0), (-12, 0, 0)),
    ),
    "relaxed": Gesture(
        {"index": (18, 24, 12), "middle": (26, 30, 15), "ring": (32, 34, 17), "pinky": (36, 34, 17)},
        {"pinky": 6},
        ((6, 0, 8), (10, 0, 0), (12, 0, 0)),
    ),
    "pinch": Gesture(
        {"index": (36, 49, 26), "middle": (26, 34, 16), "ring": (18, 26, 12), "pinky": (10, 20, 10)},
        {"index": -2},
        ((9, -16, 22), (18, 0, 0), (15, 0, 0)),
    ),
    "point": Gesture(
        {"index": (2, 2, 0), "middle": (74, 90, 63), "ring": (68, 89, 63), "pinky": (69, 87, 59)},
        {"middle": 6, "ring": 2, "pinky": -1},
        ((9, -2, -5), (31, 0, 0), (53, 0, 0)),
    ),
    "fist": Gesture(
        {"index": (74, 89, 64), "middle": (77, 92, 61), "ring": (68, 89, 66), "pinky": (69, 87, 59)},
        {"index": 2, "middle": 3, "ring": 1, "pinky": -1},
        ((16, 2, -6), (23, 0, 0), (54, 0, 0)),
    ),
    "hook": Gesture(_fingers(2, 78, 45), {"pinky": 8}, ((4, 0, 8), (12, 0, 0), (20, 0, 0))),
}


def theta_of(angles_deg: np.ndarray, axes: FingerAxes, root: np.ndarray | None = None) -> np.ndarray:
    """Compute theta [..., 16, 3] rad of joint angles [..., 15, 3] deg and the wrist's axis-angle `root` [3] rad."""
    flexion, abduction, twist = np.moveaxis(np.deg2rad(angles_deg), -1, 0)[..., None]
    rotation = (
        axis_angle_to_matrix(flexion * axes.flexion[1:])
        @ axis_angle_to_matrix(abduction * axes.dorsal[1:])
        @ axis_angle_to_matrix(twist * axes.bone[1:])
    )
    theta = np.zeros((*np.shape(angles_deg)[:-2], 16, 3))
    theta[..., 0, :] = 0 if root is None else root
    theta[..., 1:, :] = matrix_to_axis_angle(rotation)
    return theta


def angles_of(theta: np.ndarray, axes: FingerAxes) -> np.ndarray:
    """Compute joint angles [..., 15, 3] rad of theta [..., 16, 3] rad: the inverse of `theta_of`, but in radians."""
    frames = np.stack([axes.flexion, axes.bone, -axes.dorsal], -1)[1:]
    local = frames.swapaxes(1, 2) @ axis_angle_to_matrix(theta[..., 1:, :]) @ frames
    flexion = np.arctan2(local[..., 2, 1], local[..., 1, 1])
    abduction = np.arcsin(np.clip(local[..., 0, 1], -1, 1))
    twist = np.arctan2(local[..., 0, 2], local[..., 0, 0])
    return np.stack([flexion, abduction, twist], -1)


def sample_angles_deg(rng: np.random.Generator, count: int) -> np.ndarray:
    """Draw [count, 15, 3] random natural joint angles.

    Each is a sparse random mix of the gestures. Every finger is then blended by a random share with a mix of its own,
    and a few degrees of noise are added to all flexions and to the abductions of the knuckles.
    """
    library = np.stack([gesture.angles_deg() for gesture in GESTURES.values()])
    sharpness = np.full(len(library), 0.35)
    angles = np.empty((count, 15, 3))
    for k in range(count):
        whole = np.tensordot(rng.dirichlet(sharpness), library, 1)
        for finger in range(5):
            joints = slice(3 * finger, 3 * finger + 3)
            own = np.tensordot(rng.dirichlet(sharpness), library, 1)[joints]
            share = rng.beta(0.8, 1.6)
            angles[k, joints] = (1 - share) * whole[joints] + share * own
        angles[k, :, 0] += rng.normal(0, 4, 15)
        angles[k, ::3, 1] += rng.normal(0, 3, 5)
    return angles
