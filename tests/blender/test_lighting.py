"""A capture's lights in Cycles: every lamp and the sky by closed forms, groups that add up, images cut to the hand."""

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from livehand.backend.capture.capture import load_capture
from livehand.backend.capture.lights import CaptureLight
from livehand.backend.capture.plan import CapturePlan
from livehand.backend.capture.varied_light import LightDrawing, box_triangles, light_groups
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.light import Lamp, Light, Sky, sky_directions
from livehand.livehand_blender.capture import render as capture_render
from livehand.livehand_blender.capture.light_groups import LightGroupPasses
from livehand.livehand_blender.capture.lighting import SceneLighting
from livehand.livehand_blender.capture.lit_image import set_border
from livehand.livehand_blender.capture.own_surface import OwnSurface
from livehand.livehand_blender.capture.render import HandWithMaterials, is_complete, render_capture
from livehand.livehand_blender.capture.scene import capture_scene, set_camera
from livehand.livehand_blender.capture.skin import SkinTone

RGB = np.array([0.9, 0.6, 0.3])


class Card:
    """A small white diffuse card at the origin that is photographed from its front, in one light group or more."""

    def __init__(self):
        self.scene = capture_scene(threads=1)
        mesh = bpy.data.meshes.new("card")
        mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
        self.object = bpy.data.objects.new("card", mesh)
        self.object.scale = (0.005,) * 3
        mesh.materials.append(_white())
        self.scene.collection.objects.link(self.object)
        self.lighting = SceneLighting(self.scene)
        self.passes = LightGroupPasses(self.scene, 3)
        self.scene.cycles.samples = 64

    def colour(self, light, towards=(0, 0, 1)):
        """[3] of the card that faces this way."""
        towards = np.array(towards, float) / np.linalg.norm(towards)
        up = np.array([0, 0, 1.0]) if abs(towards[2]) < 0.9 else np.array([0, 1.0, 0])
        view = look_at(towards, np.zeros(3), up)
        self.object.rotation_mode = "QUATERNION"
        x, y, z = view[:3, 0], -view[:3, 1], -view[:3, 2]
        rotation = np.stack([x, y, z], 1)
        self.object.rotation_quaternion = _quaternion(rotation)
        set_camera(self.scene, Camera(np.array([[3000.0, 0, 4], [0, 3000, 4], [0, 0, 1]]), view, (8, 8)))
        self.lighting.set_lights([CaptureLight("", light)], ["group0"])
        alpha, (group,) = self.passes.render(1, is_denoised=False)
        np.testing.assert_allclose(alpha, 1)
        return group.mean((0, 1))


def _quaternion(rotation):
    from mathutils import Matrix

    return Matrix(rotation.tolist()).to_quaternion()


def _white():
    material = bpy.data.materials.new("white")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (1, 1, 1, 1)
    tree.links.new(diffuse.outputs[0], tree.nodes["Material Output"].inputs[0])
    return material


def facing(towards):
    return look_at(np.array(towards, float), np.zeros(3), np.array([0.1, 1, 0.2]))[:3, :3] @ np.diag([1, -1, -1.0])


AT = np.array([0.3, -0.4, 1.2])  # a lamp at 1.3 m, 22.6 degrees off the card's normal
FALL = AT[2] / 1.3 / 1.3**2  # cosine over distance squared


@pytest.mark.parametrize(
    ("lamp", "expected"),
    [
        (Lamp("sun", RGB, rotation=facing(AT), angle_rad=0.01), RGB * AT[2] / 1.3 / np.pi),
        (Lamp("point", 30 * RGB, AT, radius_m=0.01), 30 * RGB * FALL / (4 * np.pi) / np.pi),
        (Lamp("spot", 30 * RGB, AT, facing(AT), 0.01, cone_rad=0.5), 30 * RGB * FALL / (4 * np.pi) / np.pi),
        (Lamp("spot", 30 * RGB, AT, facing([0, 1.0, 0]), 0.01, cone_rad=0.5), 0 * RGB),
        (Lamp("area", 30 * RGB, AT, facing(AT), size_m=(0.02, 0.04)), 30 * RGB * FALL / np.pi / np.pi),
        (Lamp("area", 30 * RGB, AT, facing(AT), size_m=(0.03, 0.03), is_ellipse=True), 30 * RGB * FALL / np.pi**2),
    ],
)
def test_lamps_shine_as_the_record_says(lamp, expected):
    np.testing.assert_allclose(Card().colour(Light((lamp,))), expected, rtol=0.01, atol=1e-6)


def test_a_texel_lights_the_side_that_it_should_and_no_other():
    card = Card()
    for row, column in ((8, 5), (20, 40), (2, 60)):
        radiance = np.zeros((32, 64, 3), np.float32)
        radiance[row, column] = 50 * RGB
        sky = Sky(radiance)
        towards = sky_directions(32, 64)[row, column]
        expected = 50 * RGB * sky.solid_angles[row, column] / np.pi
        np.testing.assert_allclose(card.colour(Light(sky=sky), towards), expected, rtol=0.03)
        tilted = towards + np.cross(towards, [0.3, 0.5, 0.1]) / np.linalg.norm(np.cross(towards, [0.3, 0.5, 0.1]))
        np.testing.assert_allclose(card.colour(Light(sky=sky), tilted), expected * np.sqrt(0.5), rtol=0.05)
        assert card.colour(Light(sky=sky), -towards).max() < 1e-5


def test_lamps_are_not_seen():
    before_the_card = Light((Lamp("point", 3 * RGB, np.array([0, 0, 0.5]), radius_m=0.01),))
    np.testing.assert_allclose(Card().colour(before_the_card), 3 * RGB / (4 * np.pi * 0.25) / np.pi, rtol=0.01)


def test_the_sky_is_that_of_the_record_texel_by_texel():
    card, rng = Card(), np.random.default_rng(0)
    card.object.hide_render = True
    card.scene.render.film_transparent = False
    sky = Sky(rng.uniform(0, 5, (32, 64, 3)).astype(np.float32))
    card.lighting.set_lights([CaptureLight("", Light(sky=sky))], ["group0"])
    finer = sky_directions(32 * 5, 64 * 5)  # five directions along each side of a texel
    for row, column in rng.integers((10, 0), (150, 320), (8, 2)):
        view = look_at(np.zeros(3), finer[row, column], np.array([0, 0, 1.0]))
        set_camera(card.scene, Camera(np.array([[3000.0, 0, 4], [0, 3000, 4], [0, 0, 1]]), view, (8, 8)))
        _, (seen,) = card.passes.render(1, is_denoised=False)
        np.testing.assert_allclose(seen.mean((0, 1)), sky.radiance[row // 5, column // 5], rtol=1e-5)


def test_a_new_light_leaves_nothing_of_the_one_before():
    card = Card()
    bright = Light((Lamp("sun", 9 * RGB),), Sky(np.full((32, 64, 3), 3, np.float32)), box_at(0.3))
    card.colour(bright)
    np.testing.assert_allclose(card.colour(Light((Lamp("sun", RGB),))), RGB / np.pi, rtol=1e-3)
    grey = Light(sky=Sky(np.full((4, 8, 3), 0.25, np.float32)))
    np.testing.assert_allclose(card.colour(grey), 0.25, rtol=0.02)
    assert card.colour(Light()).max() == 0


def box_at(height_m):
    return box_triangles(np.array([0, 0, height_m]), np.eye(3), np.array([0.2, 0.2, 0.01]))


def test_occluders_cast_shadows_and_bounce_but_are_not_seen():
    card = Card()
    sun, wide = Lamp("sun", RGB), (Lamp("sun", np.pi * np.ones(3), rotation=np.diag([1, -1, -1.0])),)
    assert card.colour(Light((sun,), occluders=box_at(0.3))).max() < 1e-5
    np.testing.assert_allclose(card.colour(Light((sun,), occluders=box_at(-0.3))), RGB / np.pi, rtol=1e-3)
    # A sun from below lights a red ceiling alone, which lights the card from half of its sky.
    red = np.repeat([[0.8, 0.1, 0.1]], 12, 0)
    colour = card.colour(Light(wide, occluders=box_at(0.1), occluder_albedo=red))
    np.testing.assert_allclose(colour / colour[0], [1, 0.125, 0.125], rtol=0.02)
    assert 0.3 < colour[0] < 0.8


@pytest.fixture
def plain_scene():
    """The template with a plain skin, a pose and a view."""
    scene, hand = capture_scene(threads=1), load_default_hand()
    surface = OwnSurface.plain(hand, SkinTone())
    capture = CapturePlan(poses=1, cameras=2, size_px=(42, 64)).make(Path(), hand, {})
    surface.set_pose(capture.poses[0])
    set_camera(scene, capture.views[0].camera)
    scene.cycles.samples = 4
    return scene, capture.views[0].camera


def test_groups_add_up_to_combined_and_a_part_is_cut_from_the_whole(plain_scene):
    scene, camera = plain_scene
    lighting, passes = SceneLighting(scene), LightGroupPasses(scene, 3)
    drawing = LightDrawing(np.random.default_rng(3), np.array([0, -1.0, 0]))
    groups = ()
    while len(groups) < 3:
        groups = light_groups(drawing.light("mixed"))
    lighting.set_lights(groups, passes.names)
    whole = (0, 0, *camera.size_px)
    set_border(scene.render, whole)
    alpha, pictures = passes.render(3, is_denoised=False)
    assert alpha.shape == (64, 42)
    assert alpha.mean() > 0.1
    assert all(picture[alpha > 0.9].mean() > 1e-4 for picture in pictures)
    np.testing.assert_allclose(sum(pictures), passes.combined(), atol=2e-6)
    part = (5, 11, 33, 50)
    set_border(scene.render, part)
    cut, parts = passes.render(3)
    assert cut.shape == (39, 28)
    np.testing.assert_allclose(cut, alpha[11:50, 5:33], atol=0.3)
    assert np.abs(cut - alpha[11:50, 5:33]).mean() < 0.01
    for picture, denoised in zip(pictures, parts, strict=True):
        assert denoised.mean() == pytest.approx(picture[11:50, 5:33].mean(), rel=0.1, abs=1e-3)


LIT = CapturePlan(poses=2, cameras=5, cameras_per_pose=2, size_px=(24, 32), samples=1, eval_samples=1, eval_views=2)
LIT = replace(LIT, lights="varied")


@pytest.fixture(scope="module")
def lit(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lit")
    render_capture(folder, LIT, {"plan": LIT.facts()}, 1, HandWithMaterials(load_default_hand(), None))
    return folder


def test_a_lit_capture_reads_back_and_shows_the_hand(lit):
    capture = load_capture(lit)
    assert {view.split for view in capture.views} == {"train", "novel_camera", "novel_light"}
    for view in capture.views:
        pixels = capture.read_linear(view)
        assert 0.02 < (pixels[..., 3] > 0.5).mean() < 0.98
        assert pixels[pixels[..., 3] == 0].max(initial=0) == 0
        assert pixels.min() >= 0
        assert pixels[..., :3].max() > 1e-3
    for view in capture.of_split("novel_light"):
        beside = next(one for one in capture.of_split("train") if one.file.startswith(view.file.split("_novel")[0]))
        assert (beside.pose_index, beside.camera_index) == (view.pose_index, view.camera_index)
        a, b = (capture.read_linear(one)[..., 3] for one in (beside, view))
        assert np.abs(a - b).mean() < 0.02
    assert not list(lit.rglob("*partial*"))


def test_missing_groups_are_rendered_again_with_their_image(lit, monkeypatch):
    requested = []
    monkeypatch.setattr(capture_render, "render_views", lambda capture, views, *_: requested.extend(views))
    own = HandWithMaterials(load_default_hand(), None)
    render_capture(lit, LIT, {"plan": LIT.facts()}, 1, own)
    assert requested == []
    views = load_capture(lit).views
    image = next(v for v in views if v.file.endswith("_g1.exr"))
    path = lit / image.file
    kept = path.read_bytes()
    try:
        path.write_bytes(kept[: len(kept) // 2])
        assert not is_complete(path, image)
        render_capture(lit, LIT, {"plan": LIT.facts()}, 1, own)
        stem = image.file.removesuffix("1.exr")
        assert [v.file for v in requested] == [v.file for v in views if v.file.startswith(stem)]
        assert len(requested) > 1
        with pytest.raises(LiveHandError, match="holds another capture"):
            render_capture(lit, replace(LIT, lights="dome"), {"plan": LIT.facts()}, 1, own)
    finally:
        path.write_bytes(kept)
