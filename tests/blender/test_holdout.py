"""Holdouts, collections that are only seen indirectly, and hands that the camera does not see: as Cycles has them."""

import bpy
import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender.hands.visible_hands import visible_hands
from livehand.livehand_blender.light.foreground import Foreground
from livehand.livehand_blender.light.solids import LocalTriangles
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import find_hands, mesh_of
from mathutils import Matrix


@pytest.fixture
def scene(hand_scene, fake_session):
    """The hand in a collection of its own, before a grey wall."""
    hands = bpy.data.collections.new("Hands")
    hand_scene.collection.children.link(hands)
    for thing in (find_hands(hand_scene)[0], mesh_of(find_hands(hand_scene)[0])):
        hand_scene.collection.objects.unlink(thing)
        hands.objects.link(thing)
    wall = bpy.data.meshes.new("Wall")
    wall.from_pydata([(-2, -2, -0.2), (2, -2, -0.2), (2, 2, -0.2), (-2, 2, -0.2)], [], [(0, 1, 2, 3)])
    hand_scene.collection.objects.link(bpy.data.objects.new("Wall", wall))
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    hand_scene.collection.objects.link(sun)
    cycles = hand_scene.cycles
    cycles.samples, cycles.use_denoising, cycles.use_adaptive_sampling = 1, False, False
    hand_scene.render.film_transparent = False
    return hand_scene


@pytest.fixture
def render(tmp_path, read_exr, use_multilayer_exr):
    """A function: scene -> its passes' channels [H, W] by name."""

    def of(scene, name="shot.exr"):
        scene.render.filepath = str(tmp_path / name)
        use_multilayer_exr(scene)
        bpy.ops.render.render(write_still=True)
        return {name.partition(".")[2]: values for name, values in read_exr(tmp_path / name).items()}

    return of


def by_object(scene):
    mesh_of(find_hands(scene)[0]).is_holdout = True


def by_collection(scene):
    layer_collection(scene).holdout = True


def layer_collection(scene):
    return scene.view_layers[0].layer_collection.children["Hands"]


def from_the_camera(scene):
    mesh_of(find_hands(scene)[0]).visible_camera = False


def indirectly(scene):
    layer_collection(scene).indirect_only = True


def rgba(channels):
    return np.stack([channels[f"Combined.{c}"] for c in "RGBA"], -1)


def alpha_of(fake_session, fake_renderer):
    return fake_renderer().render(fake_session.made[-1].shots[-1]).alpha


@pytest.mark.parametrize("hold_out", [by_object, by_collection])
def test_a_holdout_leaves_a_hole_in_its_scene(scene, fake_session, fake_renderer, render, hold_out):
    scene.livehand.mode = "SCENE"
    layer = scene.view_layers[0]
    layer.livehand.use_pass_hand = layer.use_pass_normal = layer.use_pass_cryptomatte_object = True
    hold_out(scene)
    channels = render(scene)
    alpha = alpha_of(fake_session, fake_renderer)
    mesh_of(find_hands(scene)[0]).visible_camera = False
    scene.render.engine = "CYCLES"
    wall = rgba(render(scene, "wall.exr"))
    np.testing.assert_allclose(rgba(channels), (1 - alpha)[..., None] * wall, atol=1e-5)
    assert (alpha > 0.9).any()
    assert channels["Depth.Z"][alpha >= 0.5].min() > 1e9
    assert channels["HandAlpha.A"].max() == 0


@pytest.mark.parametrize("hold_out", [by_object, by_collection])
def test_a_holdout_hides_the_hand_behind_it_and_nothing_else(scene, fake_session, fake_renderer, render, hold_out):
    hold_out(scene)
    assert rgba(render(scene)).max() == 0
    other = add_hand(bpy.context, load_default_hand(), name="Other")
    other.matrix_world = Matrix.Translation((0.05, 0, -0.1))
    channels = rgba(render(scene, "two.exr"))
    held, seen = alphas(fake_session, fake_renderer)
    clear = held == 0
    np.testing.assert_allclose(channels[clear][:, 3], seen[clear], atol=0.02)
    assert channels[(held > 0.99) & (seen > 0.99)][:, 3].max() < 0.02
    assert ((held > 0.99) & (seen > 0.99)).any()
    other.location = (0, 0, 0.1)  # before the holdout
    before = rgba(render(scene, "before.exr"))
    held, seen = alphas(fake_session, fake_renderer)
    assert before[(held > 0.99) & (seen > 0.99)][:, 3].min() > 0.98


def alphas(fake_session, fake_renderer):
    """Of the last picture's two hands, each alone."""
    return [fake_renderer().render(shot).alpha for shot in fake_session.made[-1].shots[-2:]]


@pytest.mark.parametrize("hide", [from_the_camera, indirectly])
def test_a_hand_that_only_other_rays_meet_is_not_in_the_picture(scene, fake_session, render, hide):
    hide(scene)
    assert rgba(render(scene)).max() == 0
    scene.livehand.mode = "SCENE"
    ours = rgba(render(scene, "scene.exr"))
    assert fake_session.made == []
    scene.render.engine = "CYCLES"
    np.testing.assert_array_equal(ours, rgba(render(scene, "cycles.exr")))
    assert np.ptp(ours[..., 0]) > 0.05  # its shadow is


def test_an_instances_collection_decides(scene):
    """A hand in a collection that an empty of the scene instances: the empty's rays and its collection count."""
    hands = bpy.data.collections["Hands"]
    scene.collection.children.unlink(hands)
    empty = bpy.data.objects.new("Empty", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", hands
    makers = bpy.data.collections.new("Makers")
    scene.collection.children.link(makers)
    makers.objects.link(empty)
    settings = scene.view_layers[0].layer_collection.children["Makers"]
    assert [hand.is_holdout for hand in seen()] == [False]
    settings.holdout = True
    assert [hand.is_holdout for hand in seen()] == [True]
    settings.holdout, settings.indirect_only = False, True
    assert seen() == ()
    settings.indirect_only, empty.visible_camera = False, False
    assert seen() == ()


def seen():
    bpy.context.view_layer.update()
    return visible_hands(bpy.context.evaluated_depsgraph_get())


def test_what_is_only_seen_indirectly_hides_no_hand_in_views(scene):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    assert len(Foreground(depsgraph, set(), LocalTriangles())._numbers) == 2
    indirectly(scene)
    bpy.context.view_layer.update()
    assert len(Foreground(bpy.context.evaluated_depsgraph_get(), set(), LocalTriangles())._numbers) == 1
