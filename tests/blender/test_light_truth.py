"""Direct diffuse light on the bare hand, against Cycles: means within a few percent, in every kind of light."""

import bpy
import numpy as np
import pytest
import torch
from livehand.backend.capture.dome import dome_sky
from livehand.backend.capture.exr import read_exr
from livehand.backend.capture.lights import CaptureLight
from livehand.backend.capture.plan import CapturePlan
from livehand.backend.capture.varied_light import box_triangles
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.field.rays import HandInView, camera_tensors, ray_directions, ray_origin
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.topology import topology_of
from livehand.backend.light.indirect_diffuse import MeshPoints
from livehand.backend.light.lighting import SurfacePoints, diffuse_light
from livehand.backend.light.samples import LightSamples
from livehand.backend.light.shadow_maps import Bounds
from livehand.backend.records.light import Lamp, Light
from livehand.backend.records.shot import Shot
from livehand.backend.render.light_visibility import (
    NO_OCCLUDERS,
    features_with_nearby,
    light_shadows,
    nearby_geometry_of,
    sky_shadows,
    with_parts,
)
from livehand.backend.render.surface_maps import surface_maps
from livehand.livehand_blender.capture.lighting import SceneLighting
from livehand.livehand_blender.capture.node_graph import NodeGraph, enable_nodes
from livehand.livehand_blender.capture.scene import capture_scene, set_camera

SIZE = (84, 128)
NO_BOX = np.zeros((0, 3, 3))


def unit(vector):
    return np.asarray(vector, float) / np.linalg.norm(vector)


def facing(towards):
    """The rotation of a lamp in this direction that shines at the hand."""
    right = unit(np.cross([0.0, 1, 0.1], towards))
    return np.stack([right, np.cross(towards, right), towards], 1)


def lamp(kind, watts, towards, distance_m=1.0, **shape):
    towards = unit(towards)
    return Lamp(kind, np.full(3, float(watts)), distance_m * towards, facing(towards), **shape)


@pytest.fixture(scope="module")
def model():
    """The built-in right hand alone: the other side is its mirror image."""
    return load_default_hand()


@pytest.fixture(scope="module")
def plan_of_one(model, tmp_path_factory):
    """A pose and a camera that sees the whole hand."""
    capture = CapturePlan(size_px=SIZE).make(tmp_path_factory.mktemp("truth"), model, {})
    view = next(view for view in capture.views if view.pose_index == 7 and view.camera_index % 2 == 0)
    return capture.poses[7], view.camera


@pytest.fixture
def measured_by_cycles(model, plan_of_one, tmp_path_factory):
    """A function (light, camera, samples) -> [H, W, 3] direct light on the white mesh, and alpha [H, W]."""
    pose, _ = plan_of_one
    scene = capture_scene(threads=1)
    lighting = SceneLighting(scene)
    cycles, image = scene.cycles, scene.render.image_settings
    cycles.use_denoising = False
    image.file_format, image.color_depth = "OPEN_EXR", "32"
    mesh = bpy.data.meshes.new("bare")
    mesh.from_pydata(posed_vertices(model, pose).tolist(), [], model.f.tolist())
    mesh.polygons.foreach_set("use_smooth", np.ones(len(model.f), bool))
    mesh.materials.append(_white())
    scene.collection.objects.link(bpy.data.objects.new("bare", mesh))
    path = tmp_path_factory.mktemp("cycles") / "truth.exr"

    def measure(light, camera, samples, bounces=0):
        cycles.max_bounces = bounces
        set_camera(scene, camera)
        cycles.samples = samples
        lighting.set_lights([CaptureLight("", light)], [""])
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True)
        channels = read_exr(path)
        return np.stack([channels[name] for name in "RGB"], -1), channels["A"]

    return measure


def _white():
    material = bpy.data.materials.new("white")
    graph = NodeGraph(enable_nodes(material))
    graph.tree.nodes.clear()
    diffuse = graph.node("ShaderNodeBsdfDiffuse")
    diffuse.inputs[0].default_value = (1, 1, 1, 1)
    graph.connect(diffuse.outputs[0], graph.node("ShaderNodeOutputMaterial").inputs[0])
    return material


def computed(hand, pose, camera, light):
    """[H, W, 3] the diffuse light of our features, zero beside the mesh."""
    topology, backend = topology_of(hand), NumbaBackend()
    vertices = posed_vertices(hand, pose)
    mesh, view = posed_mesh(topology, torch.as_tensor(vertices, dtype=torch.float32)), camera_tensors(camera, "cpu")
    in_view = HandInView(mesh, topology, view)
    depth, face = backend.first_hit(in_view)
    pixel = depth.isfinite().nonzero()[:, 0]
    directions = ray_directions(view, pixel)
    position = ray_origin(view) + depth[pixel, None] * directions
    normals = torch.as_tensor(surface_maps(Shot(pose, vertices, camera), hand).normal.reshape(-1, 3))[pixel]
    occluders = torch.as_tensor(light.occluders, dtype=torch.float32)
    samples = LightSamples.of(light, Bounds.of(mesh))
    of_sky = sky_shadows(backend, in_view, occluders, position)
    of_sky = with_parts(of_sky, samples.sky, backend, in_view, occluders, position)
    shadows = light_shadows(backend, in_view, samples, occluders, position, of_sky, torch.ones(3))
    mesh_points = MeshPoints.of(mesh, topology.faces, face[pixel], position)
    points = SurfacePoints(position, normals, normals, torch.nn.functional.normalize(directions, dim=-1), mesh_points)
    width, height = camera.size_px
    image = torch.zeros(width * height, 3)
    around = nearby_geometry_of(backend, in_view, samples, light)
    alone = sky_shadows(backend, in_view, NO_OCCLUDERS, position)
    features = features_with_nearby(around, samples, shadows, alone, points, backend)
    image[pixel] = diffuse_light(features, normals)
    return image.reshape(height, width, 3).numpy()


KEY, SIDE = (0.9, 0.8), (0.5, 0.4)  # of the image's right and up, against the camera's axis
LIGHTS = {
    "sun": lambda key, rim: (lamp("sun", 3, key, angle_rad=0.01),),
    "point": lambda key, rim: (lamp("point", 10, key, 0.6, radius_m=0.02),),
    "near point": lambda key, rim: (lamp("point", 2, key, 0.25, radius_m=0.01),),
    "spot": lambda key, rim: (lamp("spot", 30, key, 0.7, radius_m=0.01, cone_rad=0.4, blend=0.3),),
    "large area": lambda key, rim: (lamp("area", 20, key, 0.5, size_m=(0.25, 0.25)),),
    "beam": lambda key, rim: (lamp("area", 10, key, 0.6, size_m=(0.3, 0.15), is_ellipse=True, spread_rad=1.2),),
    "dome": lambda key, rim: (),
    "blocked": lambda key, rim: (lamp("sun", 3, key, angle_rad=0.01),),
    "rim": lambda key, rim: (lamp("sun", 3, rim, angle_rad=0.01),),
}


@pytest.mark.parametrize("name", LIGHTS)
def test_direct_light_is_cycles(model, plan_of_one, measured_by_cycles, name):
    pose, camera = plan_of_one
    towards, right = -camera.cam2world[:3, 2], camera.cam2world[:3, 0]
    up = -camera.cam2world[:3, 1]
    key, rim = (sign * towards + x * right + y * up for sign, (x, y) in ((1, KEY), (-1, SIDE)))
    box = box_triangles(0.15 * unit(key) + 0.06 * right, np.eye(3), np.full(3, 0.05)) if name == "blocked" else NO_BOX
    light = Light(LIGHTS[name](key, rim), dome_sky() if name == "dome" else None, box)
    if name == "rim":  # lit along edges of one or two pixels: where their centres lie must not decide
        camera = camera.scaled(5.0)
    truth, alpha = measured_by_cycles(light, camera, 2 if name == "rim" else 32)
    ours = computed(model, pose, camera, light)
    inside = alpha > 0.99
    ratio = ours[inside].mean() / truth[inside].mean()
    assert ratio == pytest.approx(1, abs=0.06 if name == "rim" else 0.03)
    if name != "rim":
        assert np.abs(ours - truth)[inside].mean() < 0.12 * truth[inside].mean()


def test_light_that_a_wall_sheds_is_cycles(model, plan_of_one, measured_by_cycles):
    """A red wall beside the hand in a sun that does not reach what the camera sees: it alone lights that."""
    pose, camera = plan_of_one
    towards, right = -camera.cam2world[:3, 2], camera.cam2world[:3, 0]
    axes = np.stack([np.cross(towards, right), right, towards])
    wall = box_triangles(0.3 * towards + 0.15 * right, axes, np.array([0.3, 0.1, 0.006]))
    red = np.repeat([[0.8, 0.2, 0.1]], len(wall), 0)
    light = Light((lamp("sun", 3, -towards, angle_rad=0.01),), occluders=wall, occluder_albedo=red)
    dark, alpha = measured_by_cycles(light, camera, 32)
    truth, _ = measured_by_cycles(light, camera, 128, bounces=1)
    ours = computed(model, pose, camera, light)
    inside = (alpha > 0.99) & (dark.max(-1) < 1e-4)
    assert inside.mean() > 0.05
    # Of red: the hand, white in Cycles here, sheds some of the sun's light on itself, too.
    assert ours[inside, 0].mean() == pytest.approx(truth[inside, 0].mean(), rel=0.1)
