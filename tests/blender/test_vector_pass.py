"""The Vector pass of a moving hand is Cycles' own of its mesh."""

import bpy
import numpy as np
import pytest
from livehand.livehand_blender.rig.hand import find_hands


@pytest.fixture
def moving(hand_scene, use_multilayer_exr, tmp_path):
    hand = find_hands(hand_scene)[0]
    for frame, place in ((0, (-0.01, 0.012, 0)), (1, (0, 0, 0)), (2, (0.02, 0.015, 0.01))):
        hand.location = place
        hand.keyframe_insert("location", frame=frame)
    hand_scene.view_layers[0].use_pass_vector = True
    hand_scene.cycles.samples, hand_scene.cycles.use_denoising = 1, False
    hand_scene.frame_set(1)
    use_multilayer_exr(hand_scene)
    return hand_scene


def vectors(scene, path, read_exr):
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    channels = read_exr(path)
    alpha = channels["ViewLayer.Combined.A"]
    return alpha, np.stack([channels[f"ViewLayer.Vector.{c}"] for c in "XYZW"], -1)


@pytest.mark.parametrize("mode", ["HAND", "SCENE"])
def test_it_is_cycles_own(moving, fake_session, read_exr, tmp_path, mode):
    moving.livehand.mode = mode
    _, ours = vectors(moving, tmp_path / "ours.exr", read_exr)
    moving.render.engine = "CYCLES"
    alpha, theirs = vectors(moving, tmp_path / "theirs.exr", read_exr)
    both = (np.abs(ours).max(-1) > 0) & (alpha > 0.99)
    assert both.sum() > 100
    off = np.abs(ours - theirs)[both]
    assert np.median(off) < 0.05
    assert np.abs(theirs[both]).mean(0).min() > 0.3
    assert moving.frame_current == 1


def test_with_motion_blur_there_is_none(moving, fake_session, read_exr, tmp_path):
    moving.render.use_motion_blur, moving.livehand.blur_samples = True, 2
    _, ours = vectors(moving, tmp_path / "ours.exr", read_exr)
    assert not ours.any()
