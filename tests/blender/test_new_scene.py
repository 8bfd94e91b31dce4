"""A first picture in one click: what the scene then holds, that nothing of the user's is lost, and one undo."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from livehand.livehand_blender.hands.shot import world_vertices
from livehand.livehand_blender.light.studio import has_studio, needs_light
from livehand.livehand_blender.rig.hand import RiggedHand, find_hands
from livehand.livehand_blender.ui.operators import LIVEHAND_OT_add_hand
from mathutils import Vector


def views():
    areas = bpy.context.window_manager.windows[0].screen.areas
    return [area.spaces.active for area in areas if area.type == "VIEW_3D"]


@pytest.fixture
def _new_file():
    """As Blender starts: a cube, a camera and a lamp."""
    bpy.ops.wm.read_homefile(use_factory_startup_app_template_only=False, use_empty=False)
    yield
    for space in views():
        space.shading.type = "SOLID"


@pytest.mark.usefixtures("_new_file")
@pytest.mark.parametrize("side", ["right", "left"])
def test_a_new_file_becomes_a_lit_hand_before_its_camera(side, fake_session, tmp_path):
    assert {thing.name for thing in bpy.context.scene.objects} == {"Camera", "Cube", "Light"}
    for space in views():
        space.show_region_ui = False
    assert bpy.ops.livehand.new_hand_scene(side=side) == {"FINISHED"}
    scene = bpy.context.scene
    (armature,) = find_hands(scene)
    assert (armature.livehand.side, bpy.context.active_object) == (side, armature)
    assert "Cube" not in bpy.data.objects
    assert len(bpy.data.scenes) == 1
    assert scene.render.engine == "LIVEHAND"
    assert has_studio(scene)
    assert not needs_light(scene, bpy.context.view_layer)
    for space in views():
        assert (space.shading.type, space.region_3d.view_perspective) == ("RENDERED", "CAMERA")
        assert space.show_region_ui
    middle, thumb = (armature.pose.bones[f"{finger}3.{side[0].upper()}"].tail for finger in ("middle", "thumb"))
    assert (armature.matrix_world.to_3x3() @ middle).normalized().z > 0.95
    assert (armature.matrix_world.to_3x3() @ (thumb - middle)).x * {"right": -1, "left": 1}[side] > 0.02  # m
    in_picture = picture_of(scene, armature)
    assert (in_picture > 0).all()
    assert (in_picture < 1).all()
    assert 0.78 < np.ptp(in_picture, axis=0).max() < 0.86
    assert np.abs((in_picture.max(0) + in_picture.min(0)) / 2 - 0.5).max() < 0.02
    scene.render.filepath = str(tmp_path / "still.png")
    bpy.ops.render.render(write_still=True)
    assert fake_session.made[-1].shots[-1].camera.size_px == (1080, 1350)


def picture_of(scene, armature):
    """Where the hand without its arm is in the picture, shares from the lower left."""
    hand = RiggedHand.of(armature)
    vertices = world_vertices(hand.mesh.evaluated_get(bpy.context.evaluated_depsgraph_get()))
    points = vertices[hand.model.framed_vertices]
    return np.array([world_to_camera_view(scene, scene.camera, Vector(point))[:2] for point in points])


@pytest.mark.usefixtures("_new_file")
def test_beside_a_scene_with_something_in_it_it_makes_a_new_one():
    first, cube = bpy.context.scene, bpy.data.objects["Cube"]
    cube.location.x = 1.0
    bpy.context.view_layer.update()
    bpy.ops.livehand.new_hand_scene()
    assert {thing.name for thing in first.objects} == {"Camera", "Cube", "Light"}
    second = bpy.context.window.scene
    assert second != first
    assert len(find_hands(second)) == 1
    assert find_hands(first) == []
    assert first.render.engine != "LIVEHAND"


def save(tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "of_a_user.blend"))


def of_object(name, change):
    return lambda tmp_path: change(bpy.data.objects[name])


@pytest.mark.usefixtures("_new_file")
@pytest.mark.parametrize(
    "touch",
    [
        save,
        of_object("Cube", lambda cube: cube.modifiers.new("Bevel", "BEVEL")),
        of_object("Cube", lambda cube: cube.keyframe_insert("location")),
        of_object("Cube", lambda cube: cube.data.clear_geometry()),
        of_object("Camera", lambda camera: camera.keyframe_insert("location")),
    ],
    ids=["saved", "modifier", "animated", "modeled", "camera"],
)
def test_what_a_user_has_touched_is_kept(touch, tmp_path):
    first = bpy.context.scene
    touch(tmp_path)
    bpy.ops.livehand.new_hand_scene()
    assert {thing.name for thing in first.objects} == {"Camera", "Cube", "Light"}
    assert bpy.context.window.scene != first


def invoked(**settings):
    """Whether the dialog of a window would propose Studio Lights; `invoke` itself runs in windows only."""
    operator = SimpleNamespace(studio=settings.get("studio", False), execute=lambda context: {"FINISHED"})
    operator.properties = SimpleNamespace(is_property_set=lambda name: name in settings)
    assert LIVEHAND_OT_add_hand.invoke(operator, bpy.context, None) == {"FINISHED"}
    return operator.studio


def test_adding_a_hand_proposes_lights_only_where_there_are_none():
    bpy.context.scene.world = None
    assert invoked()
    assert not invoked(studio=False)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN")))
    bpy.context.view_layer.update()
    assert not invoked()
    assert invoked(studio=True)


def test_one_undo_takes_it_all_back():
    bpy.ops.ed.undo_push(message="Before")
    before = {kind: len(getattr(bpy.data, kind)) for kind in ("objects", "scenes", "cameras", "lights", "worlds")}
    bpy.ops.livehand.new_hand_scene("EXEC_DEFAULT", True)
    assert len(find_hands(bpy.context.scene)) == 1
    bpy.ops.ed.undo()
    assert {kind: len(getattr(bpy.data, kind)) for kind in before} == before
    for space in views():
        space.shading.type = "SOLID"
