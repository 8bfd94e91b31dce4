"""A custom hand model as a Blender mesh with its own look. A shape key poses it, so materials see the rest mesh."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...backend.hand.lbs import posed_vertices
from ...backend.hand.model import HandModel
from ...backend.records.shot import HandPose
from .hand_materials import append_materials
from .node_graph import NodeGraph, enable_nodes
from .skin import SkinTone

_POSED = "Posed"


@dataclass(frozen=True)
class OwnSurface:
    """A hand model and its Blender object, whose mesh before modifiers has the model's vertices."""

    model: HandModel
    object: bpy.types.Object

    @classmethod
    def of_materials(cls, model: HandModel, path: Path) -> OwnSurface:
        """Append the mesh of a look's .blend to the current scene.

        Raises:
            LiveHandError: the file cannot be read, or does not contain exactly one mesh with this model's vertices.
        """
        return cls(model, _with_shape_keys(append_materials(model, path)))

    @classmethod
    def plain(cls, model: HandModel, tone: SkinTone) -> OwnSurface:
        """Make the model's faces with a plain skin material, for a hand without a look."""
        mesh = bpy.data.meshes.new("hand")
        mesh.from_pydata(model.v_template.tolist(), [], model.f.tolist())
        mesh.polygons.foreach_set("use_smooth", np.ones(len(model.f), bool))
        rest = mesh.attributes.new("rest", "FLOAT_VECTOR", "POINT")
        rest.data.foreach_set("vector", (1e3 * model.v_template).astype(np.float32).ravel())
        mesh.materials.append(_plain_material(tone))
        hand = bpy.data.objects.new("hand", mesh)
        bpy.context.scene.collection.objects.link(hand)
        return cls(model, _with_shape_keys(hand))

    def set_pose(self, pose: HandPose) -> None:
        """Move the mesh to the pose, with the same vertices that the renderer receives."""
        posed = posed_vertices(self.model, pose).astype(np.float32)
        mesh = self.object.data
        mesh.shape_keys.key_blocks[_POSED].data.foreach_set("co", posed.ravel())
        mesh.update_tag()


def _with_shape_keys(hand: bpy.types.Object) -> bpy.types.Object:
    hand.shape_key_add(name="Rest")
    hand.shape_key_add(name=_POSED).value = 1.0
    return hand


def _plain_material(tone: SkinTone) -> bpy.types.Material:
    """Warm, pale and dark patches; folds and nails need masks, which a custom hand lacks."""
    material = bpy.data.materials.new("plain skin")
    graph = NodeGraph(enable_nodes(material))
    rest_mm = graph.attribute("rest", "Vector")
    low, mid = graph.noise(rest_mm, 0.045, 3, 0.55), graph.noise(rest_mm, 0.16, 4, 0.6)
    colour = graph.mix(graph.smooth(low, 0.35, 0.65, 0, 0.5), tone.dorsal, tone.warm_patch)
    colour = graph.mix(graph.smooth(mid, 0.42, 0.68, 0, 0.5), colour, tone.pale_patch)
    inputs = {
        "Base Color": graph.mix(graph.smooth(mid, 0.50, 0.30, 0, 0.4), colour, tone.dark_patch),
        "Roughness": 0.5,
        "Subsurface Weight": 1.0,
        "Subsurface Radius": (1.0, 0.36, 0.19),
        "Subsurface Scale": 0.0024,
    }
    shader = graph.tree.nodes["Principled BSDF"]
    for name, value in inputs.items():
        graph.connect(value, shader.inputs[name])
    return material
