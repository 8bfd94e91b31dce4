"""The factor on albedo of the teacher's skin, and the pictures of strangers that have one."""

import bpy
import numpy as np
import pytest
import trimesh
from livehand.backend.capture.exr import read_exr
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.camera import Camera, look_at
from livehand.livehand_blender.capture.node_graph import NodeGraph, enable_nodes
from livehand.livehand_blender.capture.scene import capture_scene, set_camera
from livehand.livehand_blender.capture.skin import SkinChannels, SkinTone, shade
from livehand.tools.person.filming import Job, factor_image, hand_box, render_missing
from livehand.tools.person.script import kept_scenes


def ball(folder, albedo, factor=None):
    """A ball of skin of this albedo under an even sky, linear [24, 24, 3]."""
    scene = capture_scene(threads=1)
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.exr_codec = "ZIP"
    graph = NodeGraph(enable_nodes(scene.world))
    graph.connect(graph.node("ShaderNodeBackground").outputs[0], graph.tree.nodes["World Output"].inputs[0])
    round_mesh = trimesh.creation.icosphere(3, 0.01)
    mesh = bpy.data.meshes.new("ball")
    mesh.from_pydata(round_mesh.vertices.tolist(), [], round_mesh.faces.tolist())
    material = bpy.data.materials.new("skin")
    graph = NodeGraph(enable_nodes(material))
    flat = SkinChannels(albedo, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0)
    shade(graph, graph.tree.nodes["Principled BSDF"], flat, SkinTone(), factor)
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("ball", mesh))
    K = np.array([[600.0, 0, 12], [0, 600.0, 12], [0, 0, 1]])
    set_camera(scene, Camera(K, look_at(np.array([0, 0, 0.6]), np.zeros(3), np.array([0, 1.0, 0])), (24, 24)))
    scene.cycles.samples, scene.cycles.use_denoising = 8, False
    path = folder / "ball.exr"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    channels = read_exr(path)
    return np.stack([channels[name] for name in "RGB"], -1).astype(np.float64)


def test_a_factor_multiplies_the_albedo_up_to_that_of_white_skin(tmp_path):
    multiplied = ball(tmp_path, (0.6, 0.5, 0.4), (0.5, 0.25, 2.5))
    painted = ball(tmp_path, (0.3, 0.125, 0.95))
    assert multiplied == pytest.approx(painted, rel=1e-3, abs=1e-4)
    assert np.abs(painted - ball(tmp_path, (0.6, 0.5, 0.4))).max() > 0.1


def test_the_first_row_of_a_factor_is_the_lowest_of_its_image():
    bpy.ops.wm.read_homefile(use_empty=True)
    factor = np.linspace(0.2, 1.5, 4 * 4 * 3).reshape(4, 4, 3)
    image = factor_image(factor)
    pixels = np.array(image.pixels[:]).reshape(4, 4, 4)
    assert pixels[..., :3] == pytest.approx(factor)  # Blender's pixels begin at the smallest v
    assert image.is_float


def test_a_hand_s_box_holds_it_and_little_else():
    hand = load_default_hand()
    for scene in kept_scenes(hand, np.zeros(10)):
        left, top, right, bottom = hand_box(hand, scene)
        at_px, _ = scene.camera.project(posed_vertices(hand, scene.pose))
        low, high = at_px.min(0).clip(0), at_px.max(0).clip(None, scene.camera.size_px)
        assert (low >= (left, top)).all()
        assert (high <= (right, bottom)).all()
        assert (low - (left, top)).max() < 40
        assert ((right, bottom) - high).max() < 40


def test_only_pictures_that_are_missing_are_rendered(tmp_path):
    asked, lines = [], []

    class Studio:
        def render(self, scene, path, samples, seed):
            asked.append((path.name, scene, samples, seed))

    (tmp_path / "0.exr").touch()
    jobs = [Job(tmp_path / "0.exr", "a", 0), Job(tmp_path / "1.exr", "b", 1)]
    render_missing(Studio(), jobs, 3, lines.append)
    assert asked == [("1.exr", "b", 3, 1)]
    assert len(lines) == 1
