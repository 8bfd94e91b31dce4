"""The Cycles scene of a capture: film, sampling, light and camera."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from ...backend.capture.dome import GROUND, LOBES, ZENITH, Lobe
from ...backend.records.camera import Camera
from .node_graph import NodeGraph, enable_nodes

_SENSOR_MM = 36.0
_OPENCV_TO_BLENDER = np.diag([1.0, -1.0, -1.0, 1.0])


def capture_scene(threads: int | None = None) -> bpy.types.Scene:
    """Make an empty file with a lit scene that renders transparent, denoised, exactly sRGB-encoded images."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.world = dome_world()
    _set_cycles(scene.cycles)
    _set_film(scene)
    if threads:
        scene.render.threads_mode = "FIXED"
        scene.render.threads = threads
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


def _set_cycles(cycles: bpy.types.PropertyGroup) -> None:
    settings = {
        "use_adaptive_sampling": False,
        "use_denoising": True,
        "denoiser": "OPENIMAGEDENOISE",
        "denoising_input_passes": "RGB_ALBEDO_NORMAL",
        "max_bounces": 4,
        "diffuse_bounces": 2,
        "glossy_bounces": 2,
        "transmission_bounces": 0,
        "caustics_reflective": False,
        "caustics_refractive": False,
    }
    for name, value in settings.items():
        setattr(cycles, name, value)


def _set_film(scene: bpy.types.Scene) -> None:
    scene.render.engine = "CYCLES"
    scene.render.film_transparent = True
    scene.render.use_persistent_data = True
    scene.render.dither_intensity = 0.0
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.image_settings.color_depth = "8"
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"


def set_camera(scene: bpy.types.Scene, camera: Camera) -> None:
    """Set the scene's camera to `camera`, which must have square pixels (fx = fy)."""
    width, height = camera.size_px
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    lens = scene.camera.data
    lens.sensor_fit = "HORIZONTAL"
    lens.sensor_width = _SENSOR_MM
    lens.lens = camera.K[0, 0] * _SENSOR_MM / width
    lens.shift_x = (width / 2 - camera.K[0, 2]) / width
    lens.shift_y = (camera.K[1, 2] - height / 2) / width
    scene.camera.matrix_world = Matrix((camera.cam2world @ _OPENCV_TO_BLENDER).tolist())


def dome_world() -> bpy.types.World:
    """Make a gradient from ground to sky, and four lobes."""
    world = bpy.data.worlds.new("dome")
    graph = NodeGraph(enable_nodes(world))
    direction = graph.node("ShaderNodeTexCoord").outputs["Generated"]
    separate = graph.node("ShaderNodeSeparateXYZ")
    graph.connect(direction, separate.inputs[0])
    radiance = graph.mix(graph.remap(separate.outputs["Z"], -1, 1, 0, 1), GROUND, ZENITH)
    for lobe in LOBES:
        radiance = graph.mix(1.0, radiance, _lobe_radiance(graph, direction, lobe), "ADD")
    graph.connect(radiance, graph.tree.nodes["Background"].inputs[0])
    world.cycles.sampling_method = "MANUAL"
    world.cycles.sample_map_resolution = 256
    return world


def _lobe_radiance(graph: NodeGraph, direction: bpy.types.NodeSocket, lobe: Lobe) -> bpy.types.NodeSocket:
    cosine = graph.node("ShaderNodeVectorMath", operation="DOT_PRODUCT")
    graph.connect(direction, cosine.inputs[0])
    cosine.inputs[1].default_value = np.array(lobe.towards) / np.linalg.norm(lobe.towards)
    strength = graph.math("POWER", graph.math("MAXIMUM", cosine.outputs["Value"], 0.0), float(lobe.exponent))
    return graph.mix(strength, (0.0, 0.0, 0.0), lobe.radiance)
