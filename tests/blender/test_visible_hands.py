"""Mirrored hands, and hands in collections that the scene instances or links, are seen and rendered."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.camera import Camera
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.livehand_blender.hands.proxy import hidden_from_camera, use_albedo
from livehand.livehand_blender.hands.shot import hand_vertices, read_shot
from livehand.livehand_blender.hands.visible_hands import hands_at, visible_hands
from livehand.livehand_blender.light.light import read_hand_lights
from livehand.livehand_blender.render.engine import LiveHandRender
from livehand.livehand_blender.render.frame_setup import VisibleHands, read_frame_setup
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand, all_hands, find_hands, mesh_of
from livehand.livehand_blender.rig.pose import write_theta
from mathutils import Matrix

VERTEX_COUNT = len(load_default_hand().v_template)
CAMERA = Camera(np.array([[50.0, 0, 24], [0, 50, 32], [0, 0, 1]]), np.eye(4), (48, 64))


def seen():
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return depsgraph, visible_hands(depsgraph)


def in_collection(armature):
    """The hand in a collection that no scene has."""
    collection = bpy.data.collections.new("Hands")
    for thing in (armature, mesh_of(armature)):
        for old in thing.users_collection:
            old.objects.unlink(thing)
        collection.objects.link(thing)
    return collection


def instance(collection, x, name="Empty"):
    empty = bpy.data.objects.new(name, None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    empty.location.x = x
    bpy.context.scene.collection.objects.link(empty)
    return empty


@pytest.fixture
def instanced(hand_scene):
    """The scene's hand only by two instances of its collection, 1 m apart."""
    collection = in_collection(find_hands(hand_scene)[0])
    instance(collection, 0.0, "A")
    instance(collection, 1.0, "B")
    bpy.context.view_layer.update()
    return hand_scene


@pytest.mark.parametrize("mirror", [(-1, 1, 1), (1, -1.3, 1), (-1, -1, -1)])
@pytest.mark.parametrize("side", ["right", "left"])
def test_a_mirrored_hand_is_one_of_the_other_side(side, mirror):
    model = load_default_hand().for_side(side)
    hand = RiggedHand.of(add_hand(bpy.context, model))
    theta = np.random.default_rng(0).normal(size=(16, 3)) * 0.3
    write_theta(hand, theta)
    hand.armature.scale = mirror
    bpy.context.view_layer.update()
    depsgraph, (one,) = seen()
    shot = read_shot(one, depsgraph, CAMERA, VERTEX_COUNT)
    other = "left" if side == "right" else "right"
    assert shot.pose.side == other
    # Without the object's matrix and its mirror, it is the other side's own posed mesh.
    own = posed_vertices(model.for_side(other), HandPose(shot.pose.theta, np.zeros(10), np.zeros(3), other))
    np.testing.assert_allclose(shot.vertices, own * (-1, 1, 1) * mirror, atol=1e-5)


def test_the_renderer_draws_a_mirrored_hand_as_the_hand_that_it_looks_like(hand_scene, tmp_path):
    hand_scene.livehand.light = "CAPTURE"
    hand_scene.render.resolution_x, hand_scene.render.resolution_y = 96, 128
    armature = find_hands(hand_scene)[0]
    armature.location.x = 0.02
    left = add_hand(bpy.context, load_default_hand().for_side("left"), name="Left")
    left.location.x = -0.16
    mirrored = Matrix.Diagonal((-1, 1, 1, 1)) @ Matrix.Translation((0.16, 0, 0))

    def alpha():
        task = frame_task(hand_scene)
        (sample,) = task.samples
        return [hand.run(lambda: False) for hand in sample]

    armature.hide_render = mesh_of(armature).hide_render = True
    mesh_of(armature).hide_viewport = True
    bpy.context.view_layer.update()
    (of_left,) = alpha()
    mesh_of(armature).hide_viewport, mesh_of(left).hide_viewport = False, True
    armature.matrix_world = mirrored
    bpy.context.view_layer.update()
    (of_mirrored,) = alpha()
    assert of_left.alpha.mean() > 0.03
    for one, other in ((of_mirrored.alpha, of_left.alpha), (of_mirrored.rgb, of_left.rgb)):
        np.testing.assert_allclose(one, other, atol=0.02)
        assert np.abs(one - other).mean() < 1e-4


def frame_task(scene):
    from livehand.backend.render.frame_task import FrameTask
    from livehand.livehand_blender.render.frame_setup import _read_hands
    from livehand.livehand_blender.scene.camera import read_camera

    depsgraph, hands = seen()
    loaded = VisibleHands.read(depsgraph).instances(depsgraph, LiveHandRender.required_session())
    camera = read_camera(scene.camera.evaluated_get(depsgraph), scene.render)
    return FrameTask((_read_hands(depsgraph, list(zip(loaded, hands, strict=True)), {}, camera),))


def test_every_instance_is_a_hand_in_its_own_place(instanced):
    depsgraph, hands = seen()
    assert [hand.name for hand in hands] == ["LiveHand in A 1", "LiveHand in B 1"]
    low, high = (read_shot(hand, depsgraph, CAMERA, VERTEX_COUNT).vertices for hand in hands)
    np.testing.assert_allclose(low, load_default_hand().v_template, atol=1e-6)
    np.testing.assert_allclose(high, low + np.array([1.0, 0, 0]), atol=1e-6)


def test_a_hand_beside_its_own_instance_is_seen_as_well(hand_scene):
    (armature,) = find_hands(hand_scene)
    collection = bpy.data.collections.new("Hands")
    hand_scene.collection.children.link(collection)
    for thing in (armature, mesh_of(armature)):
        collection.objects.link(thing)
    instance(collection, 0.5)
    bpy.context.view_layer.update()
    _, hands = seen()
    assert [hand.name for hand in hands] == ["LiveHand", "LiveHand in Empty 1"]


def test_an_instance_moves_with_its_empty_and_its_pose_from_frame_to_frame(instanced):
    empty = bpy.data.objects["B"]
    for frame in (1, 2):
        empty.location.x = frame
        empty.keyframe_insert("location", frame=frame)
    instanced.frame_set(1)
    depsgraph, (_, hand) = seen()
    instanced.frame_set(2)
    assert hand.matrix[0, 3] == pytest.approx(1)
    (moved,) = hands_at([hand], depsgraph)
    assert moved.matrix[0, 3] == pytest.approx(2)


def test_instances_render_blurred_with_their_own_cryptomatte(
    instanced, fake_session, use_multilayer_exr, read_exr, tmp_path
):
    empty = bpy.data.objects["B"]
    for frame in (0, 2):
        empty.location.x = 0.05 * frame
        empty.keyframe_insert("location", frame=frame)
    instanced.camera.location.x = load_default_hand().v_template[:, 0].mean()  # over the middle of A and its disc
    instanced.render.use_motion_blur, instanced.livehand.blur_samples = True, 3
    instanced.view_layers[0].use_pass_cryptomatte_object = True
    instanced.render.filepath = str(tmp_path / "still.exr")
    use_multilayer_exr(instanced)
    bpy.ops.render.render(write_still=True)
    channels = read_exr(tmp_path / "still.exr")
    offsets = [shot.vertices[0, 0] - load_default_hand().v_template[0, 0] for shot in fake_session.made[-1].shots]
    assert len({round(float(x), 4) for x in offsets}) == 4  # A stands still, B has three offsets
    assert channels["ViewLayer.Combined.A"].max() == 1


def test_instances_cast_shadows_on_each_other_but_not_on_themselves(instanced):
    bpy.data.objects["B"].location = (0, 0, 0.3)
    instanced.collection.objects.link(bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN")))
    bpy.context.view_layer.update()
    depsgraph, hands = seen()
    lights = read_hand_lights(depsgraph, hands, is_final=False)
    count = len(load_default_hand().f)
    low, high = (lights[hand.name].occluders.triangles for hand in hands)
    assert 0.5 * count < len(low) <= count
    assert 0 < len(high) <= count  # the lower one sheds light on it
    assert low[..., 2].mean() > high[..., 2].mean() + 0.2


def test_instances_are_hidden_from_cycles_camera_without_endless_updates(instanced):
    depsgraph, hands = seen()
    bpy.context.view_layer.update()
    updates = []
    bpy.app.handlers.depsgraph_update_post.append(lambda *_: updates.append(True))

    def cameras():
        return {one.object.visible_camera for one in depsgraph.object_instances if one.object.type == "MESH"}

    try:
        for _ in range(4):  # as the view does at every update
            with hidden_from_camera(depsgraph, [hand.instance_id for hand in hands]):
                assert cameras() == {False}
            bpy.context.view_layer.update()
        assert len(updates) == 1
        mesh_of(all_hands(instanced)[0]).update_tag()
        bpy.context.view_layer.update()
        assert cameras() == {True}
    finally:
        bpy.app.handlers.depsgraph_update_post.pop()


def test_a_linked_collection_renders_beside_a_local_hand_of_the_same_name(hand_scene, fake_session, tmp_path):
    path = tmp_path / "hands.blend"
    (armature,) = find_hands(hand_scene)
    bpy.data.libraries.write(str(path), {in_collection(armature)}, fake_user=True)
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        wanted.collections = ["Hands"]
    instance(wanted.collections[0], 0.0)
    add_hand(bpy.context, load_default_hand())
    scene = bpy.context.scene
    scene.render.engine = "LIVEHAND"
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    scene.camera.location.z = 0.5
    bpy.ops.render.render()
    assert len(fake_session.made[-1].shots) == 2
    assert len(all_hands(scene)) == 2
    _, hands = seen()
    assert [hand.name for hand in hands] == ["LiveHand", "LiveHand [hands.blend] in Empty 1"]


def test_in_a_scene_cycles_camera_sees_no_instance(instanced, fake_session, tmp_path, read_exr, use_multilayer_exr):
    """The fake hand is a disc; where it is empty nothing of the mesh may be seen."""
    instanced.livehand.mode, instanced.cycles.samples = "SCENE", 1
    instanced.cycles.use_denoising = False
    bpy.data.objects["B"].location.x = 5
    instanced.render.filepath = str(tmp_path / "still.exr")
    use_multilayer_exr(instanced)
    bpy.ops.render.render(write_still=True)
    channels = read_exr(tmp_path / "still.exr")
    depth = channels["ViewLayer.Depth.Z"]
    middle = fake_session.made[-1].shots[0].vertices.mean(0)
    on_mesh = (depth > 0) & (depth < 1)
    assert np.unique(np.round(depth[on_mesh], 4)).tolist() == [pytest.approx(0.5 - middle[2], abs=1e-3)]


def test_an_error_names_the_hand(instanced, fake_session):
    all_hands(instanced)[0].livehand.avatar_path = "/nowhere/x.safetensors"
    with pytest.raises(RuntimeError, match="'LiveHand in A 1' cannot be rendered: no file at"):
        bpy.ops.render.render()


def test_vertices_of_an_instance_are_in_the_world(instanced):
    bpy.data.objects["B"].scale = (2, 2, 2)
    bpy.context.view_layer.update()
    depsgraph, (_, hand) = seen()
    expected = 2 * load_default_hand().v_template + np.array([1.0, 0, 0])
    np.testing.assert_allclose(hand_vertices(hand, depsgraph), expected, atol=1e-6)


@pytest.fixture
def namesakes(hand_scene, fake_session, tmp_path):
    """A local hand and one linked from another file, as objects of one scene, with the same names."""
    path = tmp_path / "hands.blend"
    bpy.data.libraries.write(str(path), set(find_hands(hand_scene)), fake_user=True)
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        wanted.objects = ["LiveHand", "LiveHand Mesh"]
    for thing in wanted.objects:
        hand_scene.collection.objects.link(thing)
    hand_scene.livehand.mode = "SCENE"
    bpy.context.view_layer.update()
    return hand_scene


def test_namesakes_from_two_files_are_told_apart(namesakes, fake_session, fake_renderer, monkeypatch):
    mesh_names = {"LiveHand": "LiveHand Mesh", "LiveHand [hands.blend]": "LiveHand Mesh [hands.blend]"}
    monkeypatch.setattr(fake_renderer, "mean_albedo", np.array([0.5, 0.3, 0.2]))
    engine = SimpleNamespace(camera_override=namesakes.camera, frame_set=lambda *_: None)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    frame = read_frame_setup(engine, depsgraph, VisibleHands.read(depsgraph), fake_session)
    assert frame.meshes == mesh_names
    depsgraph = bpy.context.evaluated_depsgraph_get()
    use_albedo(depsgraph, {"LiveHand Mesh [hands.blend]": [0.1, 0.2, 0.3]})
    colours = {
        thing.name_full: thing.active_material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value[0]
        for thing in depsgraph.objects
        if thing.name_full in mesh_names.values()
    }
    assert colours["LiveHand Mesh [hands.blend]"] == pytest.approx(0.1)
    assert colours["LiveHand Mesh"] != pytest.approx(0.1)


def test_namesakes_have_no_cryptomatte_of_their_own(namesakes, fake_session):
    namesakes.view_layers[0].use_pass_cryptomatte_object = True
    depsgraph = bpy.context.evaluated_depsgraph_get()
    hands = VisibleHands.read(depsgraph)
    with pytest.raises(LiveHandError, match=r"'LiveHand' and 'LiveHand \[hands.blend\]' are both"):
        read_frame_setup(None, depsgraph, hands, fake_session)
