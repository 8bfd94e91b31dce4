"""Somebody's skeleton, and the record of which bone is which joint."""

import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.rigs.source_skeleton import JointMap, SourceSkeleton

NAMES = tuple(f"bone{k}" for k in range(16))


def test_bones_are_found_by_name_and_parent():
    skeleton = SourceSkeleton(
        ("root", "a", "b"), (-1, 0, 0), np.zeros((3, 3)), np.ones((3, 3)), np.tile(np.eye(3), (3, 1, 1))
    )
    assert skeleton.index("b") == 2
    assert skeleton.children(0) == [1, 2]
    assert (skeleton.ancestors(2), skeleton.ancestors(0)) == ([0], [])
    with pytest.raises(LiveHandError, match="bone 'c'"):
        skeleton.index("c")


def test_a_map_needs_the_wrist_and_two_knuckles():
    gone = (0, 1), (1, 4, 7)
    for joints in gone:
        bones = tuple(None if joint in joints else name for joint, name in enumerate(NAMES))
        with pytest.raises(LiveHandError, match="wrist and the first joints of two fingers"):
            JointMap("right", bones)


def test_joints_without_a_bone_move_with_the_joint_above():
    bones = tuple(None if joint in (3, 7, 8, 9) else name for joint, name in enumerate(NAMES))
    joint_map = JointMap("right", bones)
    assert joint_map.missing == ("index3", "pinky1", "pinky2", "pinky3")
    assert joint_map.drivers[3] == "bone2"
    assert joint_map.drivers[7:10] == ("bone0",) * 3
    assert JointMap("right", NAMES).drivers == NAMES


def test_a_map_needs_sixteen_bones():
    with pytest.raises(LiveHandError, match="16 bones and 5 tips, got 15 and 5"):
        JointMap("right", NAMES[:15])


def test_a_bone_is_one_joint_only():
    with pytest.raises(LiveHandError, match="more than once: bone3"):
        JointMap("left", NAMES, ("bone3", None, None, None, None))
