"""Blender's lamps, world and blockers of a light of the capture."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Matrix

from ...backend.capture.lights import CaptureLight
from ...backend.records.light import Lamp, Light, Sky
from .node_graph import NodeGraph, enable_nodes

_KINDS = {"sun": "SUN", "point": "POINT", "spot": "SPOT", "area": "AREA"}
_ALBEDO = "albedo"
_MAP_PX = 256  # of the map by which Cycles samples the world


class SceneLighting:
    """What lights a scene; each light replaces the one before. Lamps and occluders are not seen by the camera."""

    def __init__(self, scene: bpy.types.Scene):
        self._scene = scene
        self._objects: list[bpy.types.Object] = []
        self._image: bpy.types.Image | None = None
        self._material = _occluder_material()
        scene.world = _map_world()

    def set_lights(self, lights: Sequence[CaptureLight], groups: Sequence[str]) -> None:
        """Light the scene with the sum of these lights, each in a light group; they share their occluders.

        At most one of them may have a sky.
        """
        self._clear()
        sky, sky_group = None, ""
        for light, group in zip(lights, groups, strict=True):
            for lamp in light.light.lamps:
                self._add(_lamp_data(lamp), lamp, group)
            if light.light.sky is not None:
                sky, sky_group = light.light.sky, group
        self._set_sky(sky, sky_group)
        if len(lights[0].light.occluders):
            self._add_occluders(lights[0].light)

    def _clear(self) -> None:
        for one in self._objects:
            data = one.data
            bpy.data.objects.remove(one)
            (bpy.data.meshes if isinstance(data, bpy.types.Mesh) else bpy.data.lights).remove(data)
        self._objects.clear()

    def _add(self, data: bpy.types.Light, lamp: Lamp, group: str) -> None:
        lamp_object = bpy.data.objects.new("lamp", data)
        placement = np.eye(4)
        placement[:3, :3], placement[:3, 3] = lamp.rotation, lamp.position
        lamp_object.matrix_world = Matrix(placement.tolist())
        lamp_object.visible_camera = False
        lamp_object.lightgroup = group
        self._link(lamp_object)

    def _set_sky(self, sky: Sky | None, group: str) -> None:
        nodes = self._scene.world.node_tree.nodes
        nodes["Background"].inputs["Strength"].default_value = 0.0 if sky is None else 1.0
        self._scene.world.lightgroup = group
        if sky is not None:
            previous, self._image = self._image, _sky_image(sky)
            nodes["Environment Texture"].image = self._image
            if previous is not None:
                bpy.data.images.remove(previous)

    def _add_occluders(self, light: Light) -> None:
        corners = light.occluders.reshape(-1, 3)
        mesh = bpy.data.meshes.new("occluders")
        mesh.from_pydata(corners.tolist(), [], np.arange(len(corners)).reshape(-1, 3).tolist())
        albedo = np.zeros((len(light.occluders), 4))
        albedo[:, 3] = 1
        if len(light.occluder_albedo):
            albedo[:, :3] = light.occluder_albedo
        attribute = mesh.attributes.new(_ALBEDO, "FLOAT_COLOR", "CORNER")
        attribute.data.foreach_set("color", np.repeat(albedo, 3, 0).astype(np.float32).ravel())
        mesh.materials.append(self._material)
        occluders = bpy.data.objects.new("occluders", mesh)
        occluders.visible_camera = False
        self._link(occluders)

    def _link(self, one: bpy.types.Object) -> None:
        self._scene.collection.objects.link(one)
        self._objects.append(one)


def _lamp_data(lamp: Lamp) -> bpy.types.Light:
    data = bpy.data.lights.new("lamp", _KINDS[lamp.kind])
    data.energy = float(max(lamp.rgb.max(), 1e-12))
    data.color = lamp.rgb / data.energy
    data.use_shadow = lamp.casts_shadow
    if lamp.kind == "sun":
        data.angle = lamp.angle_rad
    elif lamp.kind == "area":
        data.shape = "ELLIPSE" if lamp.is_ellipse else "RECTANGLE"
        data.size, data.size_y = lamp.size_m
        data.spread = lamp.spread_rad
    else:
        data.shadow_soft_size = lamp.radius_m
        data.use_soft_falloff = False
    if lamp.kind == "spot":
        data.spot_size, data.spot_blend = lamp.cone_rad, lamp.blend
    return data


def _sky_image(sky: Sky) -> bpy.types.Image:
    height, width = sky.radiance.shape[:2]
    image = bpy.data.images.new("sky", width, height, float_buffer=True, alpha=False)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = sky.radiance[::-1]  # Blender's first row is the lowest
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    return image


def _map_world() -> bpy.types.World:
    """Make a world that emits an image; every texel of it is of one colour, as in `Sky`."""
    world = bpy.data.worlds.new("sky")
    graph = NodeGraph(enable_nodes(world))
    texture = graph.node("ShaderNodeTexEnvironment", name="Environment Texture", interpolation="Closest")
    background = graph.tree.nodes["Background"]
    graph.connect(texture.outputs["Color"], background.inputs["Color"])
    world.cycles.sampling_method = "MANUAL"
    world.cycles.sample_map_resolution = _MAP_PX
    return world


def _occluder_material() -> bpy.types.Material:
    material = bpy.data.materials.new("occluder")
    tree = enable_nodes(material)
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    graph = NodeGraph(tree)
    albedo = graph.node("ShaderNodeAttribute", attribute_name=_ALBEDO)
    diffuse = graph.node("ShaderNodeBsdfDiffuse")
    graph.connect(albedo.outputs["Color"], diffuse.inputs["Color"])
    graph.connect(diffuse.outputs[0], tree.nodes["Material Output"].inputs[0])
    return material
