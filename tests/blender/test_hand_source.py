"""The files, grade and device of a hand, read from its properties."""

from pathlib import Path

import bpy
import pytest
from livehand.backend.avatars.library import SHIPPED, avatar_path, shipped_avatar_path
from livehand.backend.hand.model_file import DEFAULT_HAND, builtin_hand_path, load_default_hand
from livehand.backend.image.grade import Grade
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.session import Device, Session
from livehand.livehand_blender.hands.visible_hands import visible_hands
from livehand.livehand_blender.render.hand_source import drawing_note, hand_source, read_grade, set_avatar
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand, find_hands


@pytest.fixture
def armature(hand_scene):
    return find_hands(hand_scene)[0]


def test_paths_are_resolved_against_the_blend(armature, tmp_path):
    armature.livehand.avatar_path = "//looks/mine.safetensors"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    source = hand_source(visible_hands(bpy.context.evaluated_depsgraph_get())[0].armature)
    assert source.avatar_path == tmp_path / "looks" / "mine.safetensors"
    assert source.model_path == builtin_hand_path()


def test_a_hand_without_a_file_is_the_built_in_one_with_its_avatars():
    armature = add_hand(bpy.context, load_default_hand(), "")
    source = hand_source(armature)
    assert source.model_path == builtin_hand_path()
    assert source.avatar_path == shipped_avatar_path("light")
    assert source.avatar_path.parent.name == RiggedHand.of(armature).model.name == DEFAULT_HAND


def test_people_of_numbers_are_named_while_they_load():
    paths = [shipped_avatar_path(skin) for skin in ("light", "lena", "samuel")]
    assert drawing_note(paths) == "loading Lena, Samuel: at first use, the skin is drawn in some 20 seconds"
    assert drawing_note(paths[:1]) == ""


def test_a_hand_of_a_model_whose_file_is_not_named_is_refused(armature):
    """Its mesh may have as many vertices, so nothing else would tell."""
    armature.livehand.model_sha256 = "ab" * 32
    source, session = hand_source(armature), Session()
    with pytest.raises(LiveHandError, match=r"must name the model's file, got none and the hash abababababab\.\.\."):
        source.renderer(session, Device("cpu", "fp32"))


def test_a_shipped_avatar_that_is_worn_is_kept_as_a_skin(armature):
    set_avatar(armature, avatar_path("deep"))
    assert armature.livehand.skin == "deep"
    assert armature.livehand.avatar_path == ""
    assert hand_source(armature).avatar_path == shipped_avatar_path("deep")


def test_a_file_of_ones_own_that_is_worn_is_kept(armature, tmp_path):
    set_avatar(armature, tmp_path / "deep.safetensors")
    assert hand_source(armature).avatar_path == tmp_path / "deep.safetensors"


@pytest.mark.parametrize("skin", SHIPPED)
def test_a_hand_has_the_avatar_of_its_skin_unless_it_names_a_file(armature, skin):
    armature.livehand.skin = skin
    depsgraph = bpy.context.evaluated_depsgraph_get()
    assert hand_source(visible_hands(depsgraph)[0].armature).avatar_path == avatar_path(skin)
    armature.livehand.avatar_path = "/looks/mine.safetensors"
    assert hand_source(visible_hands(depsgraph)[0].armature).avatar_path == Path("/looks/mine.safetensors")


def test_a_new_hand_has_a_neutral_grade(hand_scene):
    assert read_grade(find_hands(hand_scene)[0]) == Grade()


def test_animated_settings_are_read_from_the_evaluated_hand(hand_scene):
    (hand,) = find_hands(hand_scene)
    for frame, stops in ((1, 0.0), (11, 2.0)):
        hand.livehand.exposure, hand.livehand.gain[1], hand.livehand.bias[2] = stops, 1 + stops, stops / 20
        for name in ("exposure", "gain", "bias"):
            hand.livehand.keyframe_insert(name, frame=frame)
    hand_scene.frame_set(6)
    evaluated = hand.evaluated_get(bpy.context.evaluated_depsgraph_get())
    grade = read_grade(evaluated)
    assert grade.exposure_stops == pytest.approx(1)
    assert grade.gain == pytest.approx((1, 2, 1))
    assert grade.bias == pytest.approx((0, 0, 0.05))
