"""What the example scenes are lit and seen by: area lamps and a camera that face a point, and a dim room."""

import bpy
from livehand.livehand_blender.capture.node_graph import enable_nodes
from mathutils import Vector

Place = tuple[float, float, float]


def add_camera(scene: bpy.types.Scene, place_m: Place, target_m: Place, lens_mm: float) -> None:
    """The scene's camera."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.location = place_m
    camera.rotation_euler = (Vector(target_m) - Vector(place_m)).to_track_quat("-Z", "Y").to_euler()
    camera.data.lens, camera.data.clip_start, camera.data.clip_end = lens_mm, 0.01, 10


def add_lamp(scene: bpy.types.Scene, name: str, place_m: Place, side_m: float, power_w: float, rgb: Place) -> None:
    """A square that faces the origin."""
    data = bpy.data.lights.new(name, "AREA")
    data.energy, data.size, data.color = power_w, side_m, rgb
    lamp = bpy.data.objects.new(name, data)
    scene.collection.objects.link(lamp)
    lamp.location = place_m
    lamp.rotation_euler = Vector(place_m).to_track_quat("Z", "Y").to_euler()


def add_room(scene: bpy.types.Scene, rgba: tuple[float, float, float, float]) -> None:
    """A world of one colour."""
    scene.world = bpy.data.worlds.new("Room")
    enable_nodes(scene.world).nodes["Background"].inputs["Color"].default_value = rgba
