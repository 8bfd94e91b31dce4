"""Rigs whose coordinates are a mirror image, as left-handed axes written as they are, are mirrored back."""

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import JOINT_NAMES, MIRROR_AXIS_ANGLE, PARENTS
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.rigs.retarget import SourceMotion
from livehand.backend.rigs.rig_reading import MIRRORED_NOTE, read_motion
from livehand.backend.rigs.shape_fit import rest_nodes
from livehand.backend.rigs.source_skeleton import JointMap, SourceSkeleton

TIPS = tuple(f"tip{k}" for k in range(5))
JOINTS = [0, *(1 + 4 * finger + k for finger in range(5) for k in range(3)), *(4 * finger + 4 for finger in range(5))]
HAND = load_default_hand()
FLIP = np.diag([1.0, 1, -1])


def closing(side, count=12):
    fist, axes = GESTURES["fist"].angles_deg(), FingerAxes.of_default_hand()
    thetas = np.array([theta_of(share * fist, axes, np.array([0.2, 0, 0.1])) for share in np.linspace(0, 1, count)])
    return thetas if side == "right" else thetas * MIRROR_AXIS_ANGLE


def rig(side, mirror=None):
    """Our hand as a rig, in coordinates that are multiplied by a matrix, and a function (thetas) -> its motion."""
    mirror = np.eye(3) if mirror is None else mirror
    heads = rest_nodes(HAND.for_side(side), np.zeros(10))[JOINTS] @ mirror.T
    names = (*JOINT_NAMES, *TIPS)
    parents = (-1, *PARENTS[1:], *(3 * finger + 3 for finger in range(5)))
    frames = np.tile(np.eye(3), (21, 1, 1))
    skeleton = SourceSkeleton(names, parents, heads, np.add(heads, [0, 0.01, 0]), frames)

    def posed(thetas):
        turns = axis_angle_to_matrix(thetas)
        for joint in range(1, 16):
            turns[:, joint] = turns[:, PARENTS[joint]] @ turns[:, joint]
        return SourceMotion(mirror @ turns @ mirror.T, np.tile(heads[0], (len(thetas), 1)), 24.0, side)

    return skeleton, JointMap(side, JOINT_NAMES, TIPS), posed


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_mirrored_rig_is_mirrored_back(side):
    skeleton, joint_map, posed = rig(side, FLIP)
    found = read_motion(skeleton, joint_map, posed(closing(side)), HAND)
    assert found.motion.side == side
    assert found.doubt == MIRRORED_NOTE
    np.testing.assert_allclose(found.motion.theta[:, 1:], closing(side)[:, 1:], atol=1e-5)


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_rig_that_is_not_mirrored_is_left_alone(side):
    skeleton, joint_map, posed = rig(side)
    found = read_motion(skeleton, joint_map, posed(closing(side)), HAND)
    assert found.doubt is None
    np.testing.assert_allclose(found.motion.theta, closing(side), atol=1e-5)


def test_fingers_bent_backwards_by_a_rig_that_is_not_mirrored_are_told():
    skeleton, joint_map, posed = rig("right")
    backwards = closing("right") * np.where(np.arange(16) > 0, -1, 1)[:, None]
    found = read_motion(skeleton, joint_map, posed(backwards), HAND)
    assert "degrees backwards on average" in found.doubt
    assert found.motion.side == "right"
