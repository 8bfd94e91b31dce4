"""The rig of other_rigs.py: its reported joints and fingertips are correct, also after export and import."""

import bpy
import numpy as np
import pytest


@pytest.mark.parametrize("side", ["right", pytest.param("left", marks=pytest.mark.nightly)])
def test_exported_files_have_the_same_motion(other_rigs, tmp_path, side):
    hand = other_rigs.make_rigged_hand(side)
    frames = hand.animate()
    write = {"glb": other_rigs.write_glb, "fbx": other_rigs.write_fbx}
    read = [other_rigs.read_file(write[suffix](hand, tmp_path / f"h.{suffix}")) for suffix in write]
    names = other_rigs.JOINTS + other_rigs.TIPS
    reach = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        truth = np.concatenate([hand.joints(), hand.fingertips()])
        reach.append(np.linalg.norm(truth[16:] - truth[0], axis=1))
        for armature in read:
            np.testing.assert_allclose(other_rigs.bone_heads(armature, names), truth, atol=1e-4)
    assert np.ptp(reach, axis=0).min() > 0.02  # m: every finger bends
    assert np.max(reach) < 0.25


def test_the_rig_is_reproducible_and_mirrored(other_rigs):
    tips = [other_rigs.make_rigged_hand(side) for side in ("right", "right", "left")]
    positions = [np.linalg.inv(hand.armature.matrix_world) @ np.c_[hand.fingertips(), np.ones(5)].T for hand in tips]
    np.testing.assert_array_equal(positions[0], positions[1])
    np.testing.assert_allclose(
        np.linalg.norm(positions[0][:3], axis=0), np.linalg.norm(positions[2][:3], axis=0), rtol=1e-4
    )


def test_its_skin_follows_its_bones(other_rigs):
    hand = other_rigs.make_rigged_hand()
    hand.animate()
    bpy.context.scene.frame_set(6)
    tips = hand.fingertips()
    evaluated = hand.mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    skin = np.array([evaluated.matrix_world @ vertex.co for vertex in evaluated.data.vertices])
    gap = np.linalg.norm(skin[:, None] - tips, axis=-1).min(0)
    assert gap.max() < 0.004  # m
