"""A photographer's set-up around a hand: key, fill and rim lamps in a collection of their own, and a dim world.

Lamps are placed as seen by the scene's camera, or from the front (-Y) without one. Directions: right, towards the
camera, up; distances and sizes are those for a hand of `_HAND_M`, and grow with it.
"""

from __future__ import annotations

from typing import NamedTuple

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..hands.framing import framed_vertices
from ..rig.hand import RiggedHand, find_hands
from .world import is_dim, world_of

# Radius of the ball around a life-size hand.
_HAND_M = 0.11
_NAME = "Studio Lights"
# Custom properties of the collection; the second is absent if there was no world.
_IS_STUDIO, _WORLD_BEFORE = "livehand_studio", "livehand_world_before"
_WORLD_RGB = (0.030, 0.033, 0.040)


class _StudioLamp(NamedTuple):
    """An area lamp: direction towards it, distance and sizes, m, power, W, and colour."""

    name: str
    towards: tuple[float, float, float]
    distance_m: float
    size_m: tuple[float, float]
    power_w: float
    rgb: tuple[float, float, float]


_LAMPS = (
    _StudioLamp("Key", (-0.80, 0.58, 0.60), 0.8, (0.25, 0.25), 10.0, (1.0, 0.94, 0.86)),
    _StudioLamp("Fill", (0.80, 0.62, -0.05), 1.0, (0.8, 0.8), 1.8, (0.88, 0.94, 1.0)),
    _StudioLamp("Rim", (0.60, -0.72, 0.50), 0.8, (0.12, 0.45), 7.5, (1.0, 0.97, 0.93)),
)


def add_studio(context: bpy.types.Context, hand: bpy.types.Object | None = None) -> bpy.types.Collection:
    """Add the set-up around a hand's armature, or around all hands, or at the 3D cursor if there is none.

    An earlier set-up is replaced. The scene's world is kept and comes back with `remove_studio`.

    Raises:
        LiveHandError: a hand has no mesh.
    """
    scene = context.scene
    remove_studio(scene)
    middle, radius = _subject(context, hand)
    collection = bpy.data.collections.new(_NAME)
    scene.collection.children.link(collection)
    frame = _view_frame(scene, middle)
    for lamp in _LAMPS:
        collection.objects.link(_add_lamp(lamp, middle, frame, radius / _HAND_M))
    collection[_IS_STUDIO] = True
    if scene.world:
        collection[_WORLD_BEFORE] = scene.world
    scene.world = _dim_world()
    return collection


def remove_studio(scene: bpy.types.Scene) -> None:
    """Remove the scene's set-up, if it has one, and give back the world before it."""
    for collection in _studios(scene):
        if scene.world and scene.world.name.startswith(_NAME):  # else the user has chosen another since
            studio_world, scene.world = scene.world, collection.get(_WORLD_BEFORE)
            if not studio_world.users:
                bpy.data.worlds.remove(studio_world)
        for thing in list(collection.objects):
            if thing.type == "LIGHT" and thing.name.startswith(_NAME):
                bpy.data.lights.remove(thing.data)
        bpy.data.collections.remove(collection)


def needs_light(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> bool:
    """Return whether hands take the scene's light, the layer renders no lamp, and the scene's world is dim."""
    has_lamp = any(thing.type == "LIGHT" and not thing.hide_render for thing in layer.objects)
    return scene.livehand.light == "SCENE" and not has_lamp and is_dim(world_of(scene, layer))


def has_studio(scene: bpy.types.Scene) -> bool:
    """Return whether the scene has a set-up."""
    return bool(_studios(scene))


def _studios(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    return [one for one in scene.collection.children if one.get(_IS_STUDIO)]


def _subject(context: bpy.types.Context, hand: bpy.types.Object | None) -> tuple[Vector, float]:
    """Find the middle and radius, m, of what is lit."""
    hands = [hand] if hand else find_hands(context.scene)
    if not hands:
        return context.scene.cursor.location.copy(), _HAND_M
    depsgraph = context.evaluated_depsgraph_get()
    vertices = np.concatenate([framed_vertices(RiggedHand.of(one), depsgraph) for one in hands])
    middle = (vertices.min(0) + vertices.max(0)) / 2
    return Vector(middle.tolist()), float(np.linalg.norm(vertices - middle, axis=1).max())


def _view_frame(scene: bpy.types.Scene, middle: Vector) -> Matrix:
    """Compute columns right, level towards the camera, up; a camera straight above or below counts as at the front."""
    towards = scene.camera.matrix_world.translation - middle if scene.camera else Vector((0, -1, 0))
    level = Vector((towards.x, towards.y, 0))
    level = level.normalized() if level.length > 0.2 * towards.length else Vector((0, -1, 0))
    up = Vector((0, 0, 1))
    return Matrix((up.cross(level), level, up)).transposed()


def _add_lamp(lamp: _StudioLamp, middle: Vector, frame: Matrix, scale: float) -> bpy.types.Object:
    data = bpy.data.lights.new(f"{_NAME} {lamp.name}", "AREA")
    data.shape = "RECTANGLE"
    data.size, data.size_y = (scale * side for side in lamp.size_m)
    data.energy, data.color = lamp.power_w * scale**2, lamp.rgb
    towards = (frame @ Vector(lamp.towards)).normalized()
    thing = bpy.data.objects.new(data.name, data)
    thing.matrix_world = Matrix.LocRotScale(
        middle + scale * lamp.distance_m * towards, towards.to_track_quat("Z", "Y"), None
    )
    return thing


def _dim_world() -> bpy.types.World:
    world = bpy.data.worlds.new(_NAME)
    if bpy.app.version < (5, 0, 0):  # later versions always have nodes, and warn
        world.use_nodes = True
    assert world.node_tree is not None
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*_WORLD_RGB, 1.0)
    world.color = _WORLD_RGB
    return world
