"""The record of a hand model in MANO's format, unposed, in numpy.

Arrays keep MANO's names. Right-hand frame of the template: fingers towards -X, back of the hand +Y, thumb +Z, metres.
Source of the format: Romero et al. 2017, "Embodied Hands"; MANO v1.2 files.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..records.side import Side

MANO_FINGERS = ("index", "middle", "pinky", "ring", "thumb")
"""In the order of MANO's joints."""
JOINT_NAMES = ("wrist", *(f"{finger}{k}" for finger in MANO_FINGERS for k in (1, 2, 3)))
PARENTS = (-1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14)

# From the template's frame to a Z-up world in which the fingers point up, the back of the hand to the front (-Y) and a
# right hand's thumb to the left (-X). Captures hold the hand in this way, which fixes the light of the avatars.
UPRIGHT = np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])

_FRAMED_ARM_M = 0.03  # of an arm, from the wrist's joint on


@dataclass(frozen=True)
class HandModel:
    """V vertices, F faces, T atlas vertices, 16 joints.

    Attributes:
        name: stem of the file's name, for people.
        side: of the template.
        sha256: of the model's file, also after mirroring; avatars identify their hand model by it.
        v_template: [V, 3] m.
        f: [F, 3] vertex indices, outward by the right-hand rule. The surface is closed: if the file's is open at the
            wrist, as MANO's is, the faces of a cap follow its own.
        lbs_weights: [V, 16], rows sum to 1.
        J_regressor: [16, V], rows sum to 1.
        parents: [16] index of the parent joint, -1 for the root.
        shapedirs: [V, 3, 10] m per unit of beta.
        posedirs: [V, 3, 135] m per unit of (R - I) of joints 1..15, row-major.
        vt: [T, 2] atlas coordinates in [0, 1].
        ft: [F, 3] atlas vertex of each face corner.
        arm_weights: [V] the part of a vertex's weight of joint 0 that follows the forearm, 0 to 1; zeros: the model has
            no arm.
    """

    name: str
    side: Side
    sha256: str
    v_template: np.ndarray
    f: np.ndarray
    lbs_weights: np.ndarray
    J_regressor: np.ndarray
    parents: np.ndarray
    shapedirs: np.ndarray
    posedirs: np.ndarray
    vt: np.ndarray
    ft: np.ndarray
    arm_weights: np.ndarray

    @property
    def joints(self) -> np.ndarray:
        """[16, 3] rest joints of the mean shape, m."""
        return self.J_regressor @ self.v_template

    @property
    def has_arm(self) -> bool:
        """Whether the surface goes on into a forearm that the wrist bends against."""
        return bool(self.arm_weights.any())

    @property
    def framed_vertices(self) -> np.ndarray:
        """[V] which of them a picture of the hand is framed by: all but those of an arm beyond the wrist's crease."""
        wrist, middle_finger = self.joints[0], self.joints[4]
        elbow = (wrist - middle_finger) / np.linalg.norm(wrist - middle_finger)
        return (self.arm_weights == 0) | ((self.v_template - wrist) @ elbow < _FRAMED_ARM_M)

    def for_side(self, side: Side) -> HandModel:
        """Return this hand if it has this side, else its exact mirror image in the plane x = 0."""
        return self if side == self.side else _mirrored(self)


MIRROR_POINT = np.array([-1.0, 1.0, 1.0])
MIRROR_AXIS_ANGLE = np.array([1.0, -1.0, -1.0])
# The sign of each row-major entry of a rotation matrix under mirroring.
_MIRROR_MATRIX = np.outer(MIRROR_POINT, MIRROR_POINT).ravel()


def upright(side: Side) -> np.ndarray:
    """Return [3, 3] `UPRIGHT` for the template of a side; the left hand's is the mirror image."""
    return UPRIGHT if side == "right" else UPRIGHT * np.outer(MIRROR_POINT, MIRROR_POINT)


def _mirrored(model: HandModel) -> HandModel:
    posedirs = model.posedirs * MIRROR_POINT[:, None] * np.tile(_MIRROR_MATRIX, 15)
    return replace(
        model,
        side="left" if model.side == "right" else "right",
        v_template=model.v_template * MIRROR_POINT,
        f=model.f[:, ::-1].copy(),
        ft=model.ft[:, ::-1].copy(),
        shapedirs=model.shapedirs * MIRROR_POINT[:, None],
        posedirs=posedirs,
    )
