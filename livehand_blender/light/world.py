"""Reads the world of an evaluated frame: a plain colour at once, any other node tree by the map that Cycles renders."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...backend.records.light import Lamp, Sky
from ..scene.colour import in_rec709
from ..scene.node_values import used_nodes
from .world_map import RenderedWorld, rendered_world

_SKY_SIZE = (32, 64)
_DIM = 0.2


@dataclass(frozen=True)
class WorldLight:
    """The light that a world emits, which may have to be rendered first.

    Attributes:
        source: radiance [3] from everywhere, or the rendered map.
        group: the world's light group.
    """

    source: np.ndarray | RenderedWorld
    group: str

    def read(self) -> tuple[Sky | None, tuple[Lamp, ...]]:
        """Read the sky, None if it is black, and the suns in it; needs no bpy, and may take seconds at the first call.

        Raises:
            LiveHandError: the world cannot be rendered.
        """
        if isinstance(self.source, RenderedWorld):
            radiance, suns = self.source.map()
            radiance = smaller_map(radiance, *_SKY_SIZE)
        else:
            radiance, suns = np.broadcast_to(self.source, (*_SKY_SIZE, 3)), ()
        sky = Sky(radiance, self.group) if radiance.any() else None
        return sky, tuple(replace(sun, group=self.group) for sun in suns)

    @property
    def rendered_suns(self) -> tuple[Lamp, ...] | None:
        """The suns in it; None if it must be rendered first."""
        return self.read()[1] if not isinstance(self.source, RenderedWorld) or self.source.is_rendered else None


def read_world(depsgraph: bpy.types.Depsgraph) -> WorldLight | None:
    """Read the world as the view layer shows it; None if it gives no diffuse light.

    Raises:
        LiveHandError: the world cannot be prepared for its render.
    """
    layer = depsgraph.view_layer
    world = world_of(depsgraph.scene, layer)
    world = world and world.evaluated_get(depsgraph)
    if world is None or not layer.use_sky or not _is_visible(world):
        return None
    group = world.lightgroup if world.lightgroup in {one.name for one in layer.lightgroups} else ""
    radiance = _plain_radiance(world)
    return WorldLight(rendered_world(world, depsgraph.scene) if radiance is None else radiance, group)


def world_of(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> bpy.types.World | None:
    """Return the scene's world, or the layer's own; versions before 4.3 have no such one."""
    return getattr(layer, "world_override", None) or scene.world


def is_dim(world: bpy.types.World | None) -> bool:
    """Return whether skin is hardly visible in a world alone: one of a plain dark colour, as in a new file, or none."""
    radiance = np.zeros(3) if world is None else _plain_radiance(world)
    return radiance is not None and radiance.max() < _DIM


def _is_visible(world: bpy.types.World) -> bool:
    """Return whether diffuse surfaces meet the world; without Cycles' add-on there is no switch."""
    visibility = getattr(world, "cycles_visibility", None)
    return visibility is None or visibility.diffuse


def _plain_radiance(world: bpy.types.World) -> np.ndarray | None:
    """Read the radiance [3] of a world of one colour; None for any other."""
    tree = used_nodes(world)
    if tree is None:
        return in_rec709(np.array(world.color, np.float64))
    output = tree.get_output_node("CYCLES")
    if output is None or not output.inputs["Surface"].is_linked:
        return np.zeros(3)
    link = output.inputs["Surface"].links[0]
    node = link.from_node
    if node.type != "BACKGROUND" or node.mute or link.is_muted or any(one.is_linked for one in node.inputs):
        return None
    colour, strength = node.inputs["Color"].default_value[:3], node.inputs["Strength"].default_value
    return np.maximum(in_rec709(np.array(colour, np.float64) * strength), 0.0)


def smaller_map(radiance: np.ndarray, height: int, width: int) -> np.ndarray:
    """Average a larger map, whose size must be a multiple, over the solid angles to [height, width, 3]."""
    rows, columns = radiance.shape[0] // height, radiance.shape[1] // width
    edges = np.cos(np.arange(radiance.shape[0] + 1) * np.pi / radiance.shape[0])
    weight = (edges[:-1] - edges[1:]).reshape(height, rows, 1, 1, 1)
    blocks = radiance.reshape(height, rows, width, columns, 3)
    return (blocks * weight).sum((1, 3)) / (weight.sum((1, 3)) * columns)
