"""Hairs against thin cones of a diffuse material that Cycles renders: what they cover, and how bright they are."""

import bpy
import numpy as np
import pytest
import torch
from livehand.backend.capture.exr import read_exr
from livehand.backend.capture.lights import CaptureLight
from livehand.backend.field.rays import camera_tensors
from livehand.backend.light.lighting import LightFeatures
from livehand.backend.light.prefiltered_environment import PrefilteredEnvironment
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.light import Lamp, Light, rotation_facing
from livehand.backend.surface import hairs
from livehand.backend.surface.hairs import SEGMENTS, PosedHairs, visible_hairs, with_hairs
from livehand.livehand_blender.capture.lighting import SceneLighting
from livehand.livehand_blender.capture.node_graph import NodeGraph, enable_nodes
from livehand.livehand_blender.capture.scene import capture_scene, set_camera

SIZE, COUNT, RADIUS_M, ALBEDO = (96, 80), 80, 4e-5, 0.6


@pytest.fixture(scope="module")
def points():
    """[N, S + 1, 3] hairs of 4 to 8 mm, curved, in all directions, in a box of 3 cm around the origin."""
    random = np.random.default_rng(3)
    root = random.uniform(-0.015, 0.015, (COUNT, 1, 3)) * (1, 0.8, 0.4)
    way = random.standard_normal((COUNT, 1, 3))
    way *= random.uniform(0.004, 0.008, (COUNT, 1, 1)) / np.linalg.norm(way, axis=-1, keepdims=True)
    bend = 0.002 * random.standard_normal((COUNT, 1, 3))
    t = np.linspace(0, 1, SEGMENTS + 1)[:, None]
    return root + t * way + t * t * bend


@pytest.fixture(scope="module")
def camera():
    K = np.array([[1600.0, 0, SIZE[0] / 2], [0, 1600, SIZE[1] / 2], [0, 0, 1]])
    return Camera(K, look_at(np.array([0.05, -0.4, 0.1]), np.zeros(3), np.array([0.0, 0, 1])), SIZE)


def by_cycles(points, camera, light, path):
    """[H, W, 3] and [H, W]: colours, premultiplied, and alpha."""
    scene = capture_scene(threads=1)
    scene.cycles.use_denoising, scene.cycles.samples, scene.cycles.max_bounces = False, 256, 0
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    data = bpy.data.curves.new("hairs", "CURVE")
    data.dimensions, data.bevel_depth, data.bevel_resolution = "3D", RADIUS_M, 4
    for hair in points:
        spline = data.splines.new("POLY")
        spline.points.add(len(hair) - 1)
        for place, point, thick in zip(spline.points, hair, np.linspace(1, 0, len(hair)), strict=True):
            place.co, place.radius = (*point, 1), thick
    material = bpy.data.materials.new("hair")
    graph = NodeGraph(enable_nodes(material))
    graph.tree.nodes.clear()
    diffuse = graph.node("ShaderNodeBsdfDiffuse")
    diffuse.inputs[0].default_value = (ALBEDO, ALBEDO, ALBEDO, 1)
    graph.connect(diffuse.outputs[0], graph.node("ShaderNodeOutputMaterial").inputs[0])
    data.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("hairs", data))
    set_camera(scene, camera)
    SceneLighting(scene).set_lights([CaptureLight("", light)], [""])
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    channels = read_exr(path)
    return np.stack([channels[name] for name in "RGB"], -1), channels["A"]


def ours(points, camera, towards, irradiance):
    """The same."""
    count = len(points)
    posed = PosedHairs(
        torch.as_tensor(points, dtype=torch.float32),
        torch.tensor([[0.0, 0, 1]]).expand(count, 3),
        torch.full((count,), RADIUS_M),
        torch.full((3,), ALBEDO),
        torch.tensor(0.0),
    )
    width, height = SIZE
    rays = torch.arange(width * height // 4)
    seen = visible_hairs(posed, camera_tensors(camera, "cpu"), torch.full((height, width), torch.inf), rays)
    vectors = torch.as_tensor(towards, dtype=torch.float32) * irradiance / torch.pi
    nothing = torch.zeros(len(rays), 3, 3)
    features = LightFeatures(
        lamp_vectors=vectors.expand(len(rays), 1, 3),
        lamp_rgb=torch.ones(1, 3),
        lamp_radius_rad=torch.zeros(1),
        sky_vectors=nothing,
        lobe_visibility=nothing[:, :2, 0],
        mirrored=PrefilteredEnvironment.of(None, "cpu"),
        near_field_specular=nothing[:, :2],
        scattered=nothing[:, :2],
        arriving=torch.ones(len(rays), 3),
        reflected=nothing[:, 0],
    )
    colours, alpha = with_hairs(torch.zeros(3, height, width), torch.zeros(height, width), seen, features)
    return colours.permute(1, 2, 0).numpy(), alpha.numpy()


@pytest.mark.parametrize("towards", [(0.3, -0.8, 0.5), (0.9, 0.1, 0.3), (0.1, 0.9, 0.4)])
def test_hairs_cover_as_much_and_are_as_bright_as_cycles_has_them(points, camera, towards, tmp_path, monkeypatch):
    """From the front, from the side, and from behind; without what hairs mirror."""
    monkeypatch.setattr(hairs, "REFLECTED", 0.0)
    towards = np.array(towards) / np.linalg.norm(towards)
    light = Light((Lamp("sun", np.full(3, 4.0), rotation=rotation_facing(towards)),))
    truth, truth_alpha = by_cycles(points, camera, light, tmp_path / "hairs.exr")
    colours, alpha = ours(points, camera, towards, 4.0)
    assert 0.01 < truth_alpha.mean() < 0.2
    assert alpha.mean() == pytest.approx(truth_alpha.mean(), rel=0.03)
    assert np.corrcoef(alpha.ravel(), truth_alpha.ravel())[0, 1] > 0.95
    assert colours.mean() == pytest.approx(truth.mean(), rel=0.07)
    assert np.corrcoef(colours.ravel(), truth.ravel())[0, 1] > 0.9
