import bpy
import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.shot import HandPose
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand, find_hands, mesh_of
from livehand.livehand_blender.rig.pose import read_hand_pose, write_hand_pose
from livehand.livehand_blender.scene.settings import use_livehand


def vertices(hand):
    flat = np.empty(3 * len(mesh_of(hand).data.vertices), np.float32)
    mesh_of(hand).data.vertices.foreach_get("co", flat)
    return flat.reshape(-1, 3)


@pytest.mark.parametrize("side", ["right", "left"])
def test_add_hand_operator_makes_what_the_function_makes(side):
    assert bpy.ops.livehand.add_hand(side=side) == {"FINISHED"}
    (by_operator,) = find_hands(bpy.context.scene)
    assert bpy.context.active_object == by_operator
    by_function = add_hand(bpy.context, load_default_hand().for_side(side))
    np.testing.assert_array_equal(vertices(by_operator), vertices(by_function))
    for name in ("side", "model_path", "model_sha256"):
        assert getattr(by_operator.livehand, name) == getattr(by_function.livehand, name)
    assert {b.name: b.matrix_local for b in by_operator.data.bones} == {
        b.name: b.matrix_local for b in by_function.data.bones
    }
    assert sum(not bone.name.startswith(("DEF-", "MCH-", "IK-", "CTL-")) for bone in by_operator.data.bones) == 17


def test_add_hand_stands_upright():
    bpy.ops.livehand.add_hand()
    turned = np.array(bpy.context.active_object.matrix_basis)[:3, :3]
    np.testing.assert_allclose(turned @ [-1, 0, 0], [0, 0, 1], atol=1e-6)  # fingers up
    np.testing.assert_allclose(turned @ [0, 1, 0], [0, -1, 0], atol=1e-6)  # back of the hand to the front


def test_add_hand_uses_the_cursor_and_a_model_file(tmp_path):
    model = load_default_hand()
    arrays = {name: getattr(model, name) for name in ("v_template", "f", "J_regressor", "shapedirs", "posedirs")}
    kintree = np.array([model.parents, np.arange(16)])
    path = tmp_path / "my_left.npz"
    np.savez(path, weights=model.lbs_weights, kintree_table=kintree, vt=model.vt, ft=model.ft, **arrays)
    bpy.context.scene.cursor.location = (1, 2, 3)
    bpy.ops.livehand.add_hand(side="right", model_path=str(path))
    (hand,) = find_hands(bpy.context.scene)
    assert tuple(hand.location) == (1, 2, 3)
    assert hand.livehand.model_path == str(path)
    assert len(hand.livehand.model_sha256) == 64


def test_add_hand_reports_an_unreadable_model():
    with pytest.raises(RuntimeError, match="no hand model at"):
        bpy.ops.livehand.add_hand(model_path="/no/such/hand.npz")
    assert not find_hands(bpy.context.scene)
    assert not bpy.data.armatures


@pytest.mark.parametrize("mode", ["EDIT", "POSE"])
def test_add_hand_leaves_other_modes_first(mode):
    bpy.ops.livehand.add_hand()
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.livehand.add_hand(side="left")
    assert [hand.mode for hand in find_hands(bpy.context.scene)] == ["OBJECT", "OBJECT"]
    assert len(find_hands(bpy.context.scene)) == 2


def test_a_collection_outside_the_view_layer_is_rejected_and_nothing_is_added():
    collection = bpy.data.collections.new("Hidden")
    bpy.context.scene.collection.children.link(collection)
    layer = bpy.context.view_layer.layer_collection.children["Hidden"]
    bpy.context.view_layer.active_layer_collection = layer
    layer.exclude = True
    with bpy.context.temp_override(collection=collection), pytest.raises(RuntimeError, match="view layer"):
        bpy.ops.livehand.add_hand()
    assert not bpy.data.armatures
    assert not bpy.data.objects


def test_reset_pose_rests_the_hand_and_keeps_its_shape():
    hand = add_hand(bpy.context, load_default_hand())
    write_hand_pose(RiggedHand.of(hand), HandPose(np.full((16, 3), 0.3), np.ones(10), np.ones(3)))
    assert bpy.ops.livehand.reset_pose() == {"FINISHED"}
    pose = read_hand_pose(hand, bpy.context.evaluated_depsgraph_get())
    np.testing.assert_allclose(pose.theta, 0, atol=1e-6)
    np.testing.assert_allclose(pose.transl, 0, atol=1e-6)
    np.testing.assert_allclose(pose.beta, 1)


def test_reset_pose_works_from_the_mesh_and_reports_errors():
    with pytest.raises(RuntimeError, match="Select a LiveHand hand first"):
        bpy.ops.livehand.reset_pose()
    hand = add_hand(bpy.context, load_default_hand())
    bpy.context.view_layer.objects.active = mesh_of(hand)
    assert bpy.ops.livehand.reset_pose.poll()


def test_set_engine_does_what_the_function_does():
    first, second = bpy.context.scene, bpy.data.scenes.new("Second")
    bpy.ops.livehand.set_engine()
    use_livehand(second)
    for scene in (first, second):
        assert scene.render.engine == "LIVEHAND"
        assert scene.render.film_transparent
        assert scene.render.dither_intensity == 0
        assert scene.view_settings.view_transform == "Standard"
        assert scene.render.image_settings.color_mode == "RGBA"


def test_set_engine_keeps_a_format_without_alpha():
    bpy.context.scene.render.image_settings.file_format = "JPEG"
    use_livehand(bpy.context.scene)
    assert bpy.context.scene.render.image_settings.file_format == "JPEG"


@pytest.mark.parametrize("side", ["right", "left"])
def test_an_added_hand_stands_upright_its_back_to_the_front(side):
    bpy.ops.livehand.add_hand(side=side)
    armature = bpy.context.object
    bpy.context.view_layer.update()
    model = load_default_hand().for_side(side)
    world = np.array(armature.matrix_world)
    wrist, middle, thumb = (world[:3, :3] @ model.joints[joint] for joint in (0, 6, 15))
    assert (middle - wrist)[2] > 0.1
    assert np.sign((thumb - wrist)[0]) == (-1 if side == "right" else 1)
    back = model.v_template[np.argmax(model.v_template[:, 1])]
    assert (world[:3, :3] @ (back - model.joints[0]))[1] < 0


def test_hands_are_named_by_side():
    for side in ("right", "left", "left"):
        bpy.ops.livehand.add_hand(side=side)
    assert [hand.name for hand in find_hands(bpy.context.scene)] == ["Left Hand", "Left Hand.001", "Right Hand"]
