"""Rendering captures: Blender's camera, the posed surface, and a tiny complete capture."""

import json
from argparse import ArgumentParser
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
import torch
import trimesh
from livehand.backend.avatars.captured_surface import surface_of_capture
from livehand.backend.capture.capture import load_capture
from livehand.backend.capture.person import PERSONS, Person
from livehand.backend.capture.plan import CapturePlan
from livehand.backend.evaluation.metrics import alpha_iou
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model import HandModel
from livehand.backend.hand.model_file import load_default_hand, load_hand_model
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.surface.base_surface import base_arrays
from livehand.backend.surface.skin_version import is_current_skin
from livehand.backend.teacher.detailed_surface import detailed_surface
from livehand.livehand_blender.capture import command
from livehand.livehand_blender.capture import render as capture_render
from livehand.livehand_blender.capture.bake import bake_skin
from livehand.livehand_blender.capture.node_graph import NodeGraph, enable_nodes
from livehand.livehand_blender.capture.render import HandWithMaterials, is_complete, render_capture
from livehand.livehand_blender.capture.scene import capture_scene, set_camera
from livehand.livehand_blender.capture.skin import SkinChannels, SkinTone, shade
from livehand.livehand_blender.capture.surface import SkinSurface, crossing
from livehand.livehand_blender.scene.camera import read_camera
from PIL import Image
from scipy.spatial.transform import Rotation

SMALL = CapturePlan(poses=23, cameras=11, cameras_per_pose=4, size_px=(24, 32), eval_views=5)


@pytest.fixture(scope="module")
def right_hand():
    return load_default_hand()


@pytest.fixture(scope="module")
def made(right_hand, tmp_path_factory):
    return SMALL.make(tmp_path_factory.mktemp("plan"), right_hand, {"made_by": "test"})


def test_tones_differ_like_skins():
    light, deep = SkinTone.of(PERSONS["light"]), SkinTone.of(PERSONS["deep"])
    np.testing.assert_allclose(light.dorsal, SkinTone().dorsal)
    assert SkinTone.of(Person(melanin=0.5)).palm[0] == pytest.approx((light.palm[0] * deep.palm[0]) ** 0.5)
    flushed = SkinTone.of(Person(blood=1.5))
    assert flushed.dorsal[1] / light.dorsal[1] < flushed.dorsal[0] / light.dorsal[0] < 1
    luminance = np.array([0.2126, 0.7152, 0.0722])
    assert luminance @ deep.dorsal < 0.35 * (luminance @ light.dorsal)
    assert luminance @ deep.palm > 2 * (luminance @ deep.dorsal)  # palms are pale on dark hands


@pytest.mark.parametrize("size_px", [(24, 32), (167, 256), (300, 200)])
def test_blenders_camera_matches_the_record(size_px):
    scene = bpy.context.scene
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    K = np.array([[350.0, 0, size_px[0] / 2 + 3.2], [0, 350.0, size_px[1] / 2 - 1.7], [0, 0, 1]])
    camera = Camera(K, look_at(np.array([0.4, -0.6, 0.3]), np.array([0.02, 0, 0]), np.array([0, 0, 1.0])), size_px)
    set_camera(scene, camera)
    bpy.context.view_layer.update()
    back = read_camera(scene.camera.evaluated_get(bpy.context.evaluated_depsgraph_get()), scene.render)
    assert back.size_px == size_px
    points = np.random.default_rng(0).normal(0, 0.05, (50, 3))
    for ours, theirs in zip(back.project(points), camera.project(points), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-3)


def test_every_planned_camera_survives_a_round_trip(made):
    scene = capture_scene()
    cameras = {view.camera_index: view.camera for view in made.views}
    points = np.random.default_rng(1).normal(0, 0.05, (20, 3))
    for camera in cameras.values():
        set_camera(scene, camera)
        bpy.context.view_layer.update()
        back = read_camera(scene.camera.evaluated_get(bpy.context.evaluated_depsgraph_get()), scene.render)
        assert np.abs(back.project(points)[0] - camera.project(points)[0]).max() < 1e-3


def test_the_scene_writes_straight_srgb_without_dither():
    scene = capture_scene(threads=1)
    assert (scene.view_settings.view_transform, scene.render.dither_intensity) == ("Standard", 0.0)
    assert scene.render.film_transparent
    assert (scene.render.threads_mode, scene.render.threads) == ("FIXED", 1)


@pytest.fixture(scope="module")
def coarse_surface(right_hand):
    return detailed_surface(right_hand, levels=1)


def test_the_surface_follows_the_hand(coarse_surface, right_hand, made):
    capture_scene()
    surface = SkinSurface.create(right_hand, coarse_surface, veins_mm=0.0)
    pose = made.poses[0]
    surface.set_pose(pose)
    posed = surface.posed_vertices(pose)
    mesh = np.empty(3 * len(posed), np.float32)
    surface.object.data.vertices.foreach_get("co", mesh)
    np.testing.assert_allclose(mesh.reshape(-1, 3), posed, atol=1e-6)
    # Subdivision, relaxation and details move it by little from the template's own skin.
    template = posed_vertices(right_hand, pose)
    near = np.linalg.norm(template[:, None] - posed[None], axis=-1).min(1)
    assert np.median(near) < 0.0025
    assert near.max() < 0.008
    still = HandPose.rest()
    np.testing.assert_allclose(surface.posed_vertices(still), coarse_surface.vertices_m, atol=1e-9)


def test_the_surface_follows_the_forearm():
    model = load_hand_model("hand_with_arm")
    capture_scene()
    surface = SkinSurface.create(model, detailed_surface(model, levels=0), veins_mm=0.0)
    on_arm = surface.detail.arm_weights > 0.9999
    for turn in (np.zeros(3), np.array([0.3, 0.2, 0.8]), np.array([-0.4, 0, -0.9])):
        pose = HandPose(np.zeros((16, 3)), np.zeros(10), np.array([0.1, 0, 0.2]), "right", turn)
        at_rest = surface.detail.vertices_m + surface.detail.relief_m(pose.theta, 0.0, turn)
        turned = (at_rest - model.joints[0]) @ Rotation.from_rotvec(turn).as_matrix().T + model.joints[0] + pose.transl
        posed = surface.posed_vertices(pose)
        np.testing.assert_allclose(posed[on_arm], turned[on_arm], atol=2e-6)
        on_hand = surface.detail.arm_weights < 1e-9
        np.testing.assert_allclose(posed[on_hand], (at_rest + pose.transl)[on_hand], atol=2e-6)
    flexed = surface.detail.relief_m(np.zeros((16, 3)), 0.0, np.array([0, 0, -0.9]))
    raised = np.linalg.norm(flexed, axis=1) > 3e-4
    assert raised.any()
    assert surface.detail.normals[raised, 1].max() < 0.2  # tendons on the palmar side
    assert np.abs(surface.detail.relief_m(np.zeros((16, 3)), 0.0, np.zeros(3))).max() == 0


def test_a_built_in_hand_is_captured_by_its_name():
    parser = ArgumentParser()
    command.add_arguments(parser)
    chosen = command._hand(parser.parse_args(["-o", "x", "--hand", "hand_with_arm"]))
    assert isinstance(chosen, HandModel)
    assert chosen.has_arm
    assert command._hand(parser.parse_args(["-o", "x"])) is None
    with pytest.raises(LiveHandError, match="--look"):
        command._hand(parser.parse_args(["-o", "x", "--hand", "hand_with_arm", "--look", "x.blend"]))


def test_shape_and_translation_move_the_surface(coarse_surface, right_hand):
    capture_scene()
    surface = SkinSurface.create(right_hand, coarse_surface)
    rest = surface.posed_vertices(HandPose.rest())
    moved = surface.posed_vertices(replace(HandPose.rest(), transl=np.array([0.1, -0.2, 0.3])))
    np.testing.assert_allclose(moved - rest, np.broadcast_to([0.1, -0.2, 0.3], rest.shape), atol=1e-9)
    beta = np.eye(10)[0]
    grown = surface.posed_vertices(replace(HandPose.rest(), beta=beta))
    np.testing.assert_allclose(grown - rest, coarse_surface.subdivision @ (right_hand.shapedirs @ beta), atol=1e-9)


def test_bending_a_finger_changes_flex_only_at_its_joint(coarse_surface, right_hand):
    capture_scene()
    surface = SkinSurface.create(right_hand, coarse_surface)
    theta = np.zeros((16, 3))
    theta[5] = coarse_surface.flex_axis[5] * np.deg2rad(65)  # the middle finger's middle joint
    flex = surface._flex(theta)
    joint = coarse_surface.masks["jid"].astype(int)
    assert (joint == 5).sum() > 20
    np.testing.assert_allclose(flex[joint == 5], 1.0)
    assert np.abs(flex[joint != 5]).max() == 0
    assert surface._flex(-theta)[joint == 5].max() == 0  # bent backwards: no fold


def test_nails_are_smooth_and_folds_lie_on_the_back(coarse_surface, right_hand, tmp_path):
    capture_scene(threads=1)
    surface = SkinSurface.create(right_hand, coarse_surface)
    sampling = bpy.context.scene.cycles.samples, bpy.context.scene.cycles.use_denoising
    maps = bake_skin(surface.object, tmp_path, SkinTone(), size_px=384)
    assert (bpy.context.scene.cycles.samples, bpy.context.scene.cycles.use_denoising) == sampling
    relief, fold_dorsal, _ = _at_vertices(maps["height"], coarse_surface).T
    roughness, subsurface, _ = _at_vertices(maps["mask"], coarse_surface).T
    masks = coarse_surface.masks
    nail, palm, back = masks["nailrim"] < 0.75, masks["palm"] > 0.99, masks["foldd"] > 0.5
    assert nail.sum() > 20
    # Vertices on the border of a chart may read the next one.
    assert np.percentile(np.abs(roughness[nail] - 0.22), 95) < 0.01
    assert np.percentile(np.abs(relief[nail]), 95) < 0.01
    assert np.percentile(subsurface[nail], 95) < 0.85
    assert np.percentile(roughness[palm], 1) > 0.35
    assert np.percentile(fold_dorsal[palm], 99) < 0.05
    assert np.percentile(fold_dorsal[back], 90) > 0.2


def test_maps_of_another_person_are_baked_anew(coarse_surface, right_hand, tmp_path):
    capture_scene(threads=1)
    surface = SkinSurface.create(right_hand, coarse_surface)
    tones = {melanin: SkinTone.of(Person(melanin=melanin)) for melanin in (0.0, 1.0)}
    albedo = bake_skin(surface.object, tmp_path, tones[0.0], size_px=32)["albedo"]
    of_light, written_ns = _at_vertices(albedo, coarse_surface).mean(), albedo.stat().st_mtime_ns
    bake_skin(surface.object, tmp_path, tones[0.0], size_px=32)
    assert albedo.stat().st_mtime_ns == written_ns
    bake_skin(surface.object, tmp_path, tones[1.0], size_px=32)
    assert _at_vertices(albedo, coarse_surface).mean() < 0.6 * of_light
    (tmp_path / "maps.sha256").unlink()  # as of a version that kept no record
    bake_skin(surface.object, tmp_path, tones[0.0], size_px=32)
    assert _at_vertices(albedo, coarse_surface).mean() == pytest.approx(of_light, rel=1e-3)


def _at_vertices(path, detail):
    """[N, 3] of a baked map at the vertices."""
    image = bpy.data.images.load(str(path))
    pixels = np.empty((image.size[1], image.size[0], 4), np.float32)
    image.pixels.foreach_get(pixels.ravel())
    bpy.data.images.remove(image)
    uv = np.zeros((len(detail.vertices_m), 2))
    uv[detail.faces.ravel()] = detail.uv.reshape(-1, 2)
    size = np.array(pixels.shape[1::-1])
    column, row = np.clip((uv * size).astype(int), 0, size - 1).T
    return pixels[row, column, :3]


def _grid(across, up, count=41, cell_m=5e-4):
    """Vertices and triangles of a square grid around the origin, in the plane of two axes."""
    i, j = (index.ravel() for index in np.mgrid[:count, :count])
    vertices = ((i - count // 2)[:, None] * np.eye(3)[across] + (j - count // 2)[:, None] * np.eye(3)[up]) * cell_m
    corner = np.arange(count * count).reshape(count, count)[:-1, :-1].ravel()
    faces = np.stack([corner, corner + count, corner + 1, corner + 1, corner + count, corner + count + 1], 1)
    return vertices + 1e-4, faces.reshape(-1, 3)


def test_crossing_falls_with_the_distance_from_where_parts_cross():
    (level, faces), (upright, _) = _grid(0, 1), _grid(1, 2)
    both = np.concatenate([level, upright + 2e-4 * np.eye(3)[0]]), np.concatenate([faces, faces + len(level)])
    expected = 1 - np.minimum(np.r_[np.abs(level[:, 0]), np.abs(upright[:, 2])] / 5e-3, 1)
    np.testing.assert_allclose(crossing(*both), expected, atol=0.15)
    assert crossing(level, faces).max() == 0
    assert crossing(level, faces).dtype == np.float32


def test_parts_that_cross_leave_no_tinted_line(tmp_path):
    """Red light is scattered farthest: without the mark it ends inside the other part, and the line is teal.

    In Blender 5.2 it passes through the other part instead, and the line is red.
    """
    marked, unmarked = (_red_by_blue_where_balls_cross(tmp_path, is_marked) for is_marked in (True, False))
    assert marked == pytest.approx(1, abs=0.07)
    assert unmarked > 1.3 if bpy.app.version >= (5, 2) else unmarked < 0.85


def _red_by_blue_where_balls_cross(folder, is_marked):
    """Red by blue at the line where two grey balls cross, under an even sky."""
    scene = capture_scene(threads=1)
    graph = NodeGraph(enable_nodes(scene.world))
    graph.connect(graph.node("ShaderNodeBackground").outputs[0], graph.tree.nodes["World Output"].inputs[0])
    balls = [trimesh.creation.icosphere(4, 0.01).apply_translation((x, 0, 0)) for x in (-0.007, 0.007)]
    both = trimesh.util.concatenate(balls)
    mesh = bpy.data.meshes.new("balls")
    mesh.from_pydata(both.vertices.tolist(), [], both.faces.tolist())
    mark = crossing(np.asarray(both.vertices, np.float32), both.faces) * is_marked
    mesh.attributes.new("crossing", "FLOAT", "POINT").data.foreach_set("value", mark)
    material = bpy.data.materials.new("skin")
    graph = NodeGraph(enable_nodes(material))
    flat = SkinChannels((0.6, 0.6, 0.6), 0.5, 1.0, 0.0, 0.0, 0.0, 0.0)
    shade(graph, graph.tree.nodes["Principled BSDF"], flat, SkinTone())
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("balls", mesh))
    K = np.array([[1200.0, 0, 24], [0, 1200.0, 12], [0, 0, 1]])
    set_camera(scene, Camera(K, look_at(np.array([0, 0, 0.6]), np.zeros(3), np.array([0, 1.0, 0])), (48, 24)))
    scene.cycles.samples = 64
    scene.render.filepath = str(folder / f"{is_marked}.png")
    bpy.ops.render.render(write_still=True)
    image = (np.asarray(Image.open(scene.render.filepath), float)[10:14, :, :3] / 255) ** 2.2
    red, _, blue = image[:, 23:25].mean((0, 1))
    return red / blue


TINY = CapturePlan(poses=1, cameras=2, size_px=(24, 32), samples=1, eval_samples=1)


@pytest.fixture(scope="module")
def tiny(coarse_surface, tmp_path_factory):
    """A capture of one pose and two cameras, rendered once, with a coarse surface and a small bake."""
    folder = tmp_path_factory.mktemp("tiny")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(capture_render, "detailed_surface", lambda model: coarse_surface)
        patch.setattr(capture_render, "bake_skin", partial(bake_skin, size_px=64))
        render_capture(folder, TINY, {"made_by": "test"}, threads=1)
    return folder


@pytest.fixture
def no_renders(monkeypatch, coarse_surface):
    """The files that would be rendered, none of which is."""
    requested = []
    monkeypatch.setattr(capture_render, "detailed_surface", lambda model: coarse_surface)
    monkeypatch.setattr(
        capture_render, "render_views", lambda capture, views, *_: requested.extend(v.file for v in views)
    )
    return requested


def test_a_capture_of_one_split_has_its_views_alone(no_renders, tmp_path):
    plan = replace(TINY, poses=6, cameras=4)
    capture = render_capture(tmp_path, plan, {"made_by": "test"}, split="test")
    assert [view.split for view in capture.views] == ["test"]
    assert no_renders == [capture.views[0].file]
    with pytest.raises(LiveHandError, match="another capture"):
        render_capture(tmp_path, plan, {"made_by": "test"}, split="novel_pose")


def test_a_tiny_capture_reads_back_and_shows_the_hand(tiny, right_hand):
    capture = load_capture(tiny)
    assert len(capture.views) == 2
    for view in capture.views:
        image = capture.read_image(view)
        positions_px, depth = view.camera.project(posed_vertices(right_hand, capture.poses[0]))
        mesh = (torch.as_tensor(value) for value in (positions_px, depth, right_hand.f))
        covered = torch.zeros(32 * 24)
        covered[rasterise(*mesh, view.camera.size_px).pixel] = 1
        assert alpha_iou(torch.as_tensor(image[..., 3]), covered.reshape(32, 24)) > 0.85
        skin = image[..., :3][image[..., 3] > 0.99]
        assert len(skin) > 50
        red, green, blue = skin.mean(0)
        assert red > green > blue > 0.05
        assert image[..., :3][image[..., 3] == 0].max(initial=0) == 0
    assert not list(tiny.glob("images/*partial*"))


def test_a_capture_has_the_surface_of_its_person(tiny):
    surface = surface_of_capture(load_capture(tiny))
    assert (surface.person, surface.hand_sha256, surface.base) == (TINY.person, load_default_hand().sha256, None)
    assert surface.arrays.keys() == base_arrays().keys()


def test_painted_nails_and_materials_of_ones_own_have_no_known_surface(tmp_path, no_renders):
    hand = load_default_hand()
    painted = replace(TINY, person=Person(nail_polish=(0.5, 0.0, 0.0)))
    for name, plan, subject in (("painted", painted, hand), ("own", TINY, HandWithMaterials(hand, None))):
        capture = render_capture(tmp_path / name, plan, {"made_by": "test"}, hand=subject)
        assert (capture.surface, (tmp_path / name / "surface.npz").exists()) == (None, False)


def test_a_complete_capture_is_not_rendered_again(tiny, no_renders):
    render_capture(tiny, TINY, {"made_by": "test"})
    assert no_renders == []


def test_a_capture_of_another_skin_is_not_continued(tiny, no_renders):
    with pytest.raises(LiveHandError, match="skin"):
        render_capture(tiny, TINY, {"made_by": "test", "skin_version": "another"})
    assert no_renders == []


def test_missing_and_truncated_images_are_rendered_again(tiny, no_renders):
    first, second = sorted((tiny / "images").iterdir())
    kept = first.read_bytes(), second.read_bytes()
    try:
        second.write_bytes(kept[1][: len(kept[1]) // 2])
        render_capture(tiny, TINY, {"made_by": "test"})
        assert no_renders == [f"images/{second.name}"]
        first.unlink()
        render_capture(tiny, TINY, {"made_by": "test"})
        assert no_renders[1:] == [f"images/{first.name}", f"images/{second.name}"]
    finally:
        first.write_bytes(kept[0])
        second.write_bytes(kept[1])


@pytest.mark.parametrize("plan", [replace(TINY, seed=1), replace(TINY, size_px=(32, 32)), replace(TINY, poses=2)])
def test_the_folder_of_another_capture_is_not_changed(tiny, no_renders, plan):
    before = (tiny / "transforms.json").read_bytes(), (tiny / "poses.npz").read_bytes()
    with pytest.raises(LiveHandError, match="holds another capture"):
        render_capture(tiny, plan, {"made_by": "test"})
    assert ((tiny / "transforms.json").read_bytes(), (tiny / "poses.npz").read_bytes()) == before
    assert no_renders == []


def test_an_unwritable_folder_is_an_error(tmp_path, no_renders):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(LiveHandError, match="must be writable"):
        render_capture(tmp_path / "file", TINY, {"made_by": "test"})


def test_the_same_seed_renders_the_same_image(tiny, coarse_surface, tmp_path, monkeypatch):
    monkeypatch.setattr(capture_render, "detailed_surface", lambda model: coarse_surface)
    monkeypatch.setattr(
        capture_render, "bake_skin", lambda surface, folder, tone: bake_skin(surface, tiny / "skin", tone, 64)
    )
    render_capture(tmp_path, TINY, {"made_by": "test"}, threads=1)
    for path in sorted((tiny / "images").iterdir()):
        with Image.open(path) as one, Image.open(tmp_path / "images" / path.name) as other:
            np.testing.assert_allclose(np.asarray(other, int), np.asarray(one, int), atol=1)


def test_is_complete(tmp_path, made):
    view = made.views[0]
    path = tmp_path / "image.png"
    assert not is_complete(path, view)
    Image.new("RGBA", (24, 32)).save(path)
    assert is_complete(path, view)
    Image.new("RGBA", (32, 24)).save(path)
    assert not is_complete(path, view)
    path.write_bytes(b"")
    assert not is_complete(path, view)


@pytest.fixture
def planned(monkeypatch):
    """What the command asks of `render_capture`, which makes the capture's file but no images."""
    asked = []

    def fake(folder, plan, provenance, threads, hand=None):
        asked.append(SimpleNamespace(folder=folder, plan=plan, provenance=provenance, threads=threads))
        return plan.make(folder, load_default_hand(), provenance)

    monkeypatch.setattr(capture_render, "render_capture", fake)
    return asked


def test_the_command_passes_its_arguments_to_the_plan(planned, tmp_path):
    parser = ArgumentParser()
    command.add_arguments(parser)
    text = f"-o {tmp_path} --seed 7 --poses 12 --cameras 5 --size 32x48 --samples 2 --eval-samples 3 --eval-views 1"
    others = "--cameras-per-pose 3 --person deep --first-poses 9 --threads 2"
    result = command.run(parser.parse_args([*text.split(), *others.split()]))
    (asked,) = planned
    assert asked.plan == CapturePlan(7, 12, 5, 3, PERSONS["deep"], (32, 48), 2, 3, 1, 9)
    assert (asked.folder, asked.threads) == (tmp_path, 2)
    assert json.loads(json.dumps(result))["poses"] == 12
    assert result["train"] == 8 * 3
    defaults = parser.parse_args(["-o", "x"])
    assert command._plan(defaults, None) == CapturePlan()


def test_the_command_passes_its_lights_on(planned, tmp_path):
    parser = ArgumentParser()
    command.add_arguments(parser)
    text = f"-o {tmp_path} --poses 3 --cameras 5 --cameras-per-pose 2 --eval-views 4"
    dome, varied = (command.run(parser.parse_args([*text.split(), *more])) for more in ([], ["--lights", "varied"]))
    assert "novel_light" not in dome
    assert varied["novel_light"] == 4
    assert varied["train"] > dome["train"] == 6
    assert "lights" not in planned[0].provenance["plan"]
    assert planned[1].provenance["plan"]["lights"] == "varied"


def test_the_command_tells_which_skin_it_shows(planned, tmp_path):
    parser = ArgumentParser()
    command.add_arguments(parser)
    text = f"-o {tmp_path} --poses 3 --cameras 5 --cameras-per-pose 2 --eval-views 4"
    for person in ("light", "deep", "light"):
        command.run(parser.parse_args([*text.split(), "--person", person]))
    shown = [asked.provenance for asked in planned]
    assert all(is_current_skin(provenance) for provenance in shown)
    assert shown[0]["skin_tone"] == shown[2]["skin_tone"] != shown[1]["skin_tone"]


@pytest.mark.parametrize("size", ["24", "axb", "8x64", "24x32x3"])
def test_a_bad_size_is_a_usage_error(size, capsys):
    parser = ArgumentParser()
    command.add_arguments(parser)
    with pytest.raises(SystemExit):
        parser.parse_args(["-o", "x", "--size", size])
    assert "--size" in capsys.readouterr().err
