"""A hand model of one's own as a Blender mesh in its own look, moved by a shape key: materials see the resting mesh."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...backend.hand.lbs import posed_vertices
from ...backend.hand.model import HandModel
from ...backend.records.shot import HandPose
from .look import append_look
from .node_graph import NodeGraph
from .skin import SkinTone

_POSED = "Posed"


@dataclass(frozen=True)
class OwnSurface:
    """A hand model and its Blender object, whose first vertices, before subdivision, are the model's."""

    model: HandModel
    object: bpy.types.Object

    @classmethod
    def of_look(cls, model: HandModel, path: Path) -> OwnSurface:
        """Append the mesh of a look's .blend to the current scene.

        Raises:
            LiveHandError: the file cannot be read, or does not hold one mesh of this model's vertices.
        """
        surface = cls(model, append_look(model, path))
        surface.object.shape_key_add(name="Rest")
        surface.object.shape_key_add(name=_POSED).value = 1.0
        return surface

    @classmethod
    def plain(cls, model: HandModel, tone: SkinTone) -> OwnSurface:
        """The model's own faces in a plain skin, for a hand without a look."""
        mesh = bpy.data.meshes.new("hand")
        mesh.from_pydata(model.v_template.tolist(), [], model.f.tolist())
        mesh.polygons.foreach_set("use_smooth", np.ones(len(model.f), bool))
        rest = mesh.attributes.new("rest", "FLOAT_VECTOR", "POINT")
        rest.data.foreach_set("vector", (1e3 * model.v_template).astype(np.float32).ravel())
        mesh.materials.append(_plain_material(tone))
        surface = cls(model, bpy.data.objects.new("hand", mesh))
        bpy.context.scene.collection.objects.link(surface.object)
        surface.object.shape_key_add(name="Rest")
        surface.object.shape_key_add(name=_POSED).value = 1.0
        return surface

    def set_pose(self, pose: HandPose) -> None:
        """Move the mesh to the pose: its vertices are what the renderer is given."""
        posed = posed_vertices(self.model, pose).astype(np.float32)
        mesh = self.object.data
        mesh.shape_keys.key_blocks[_POSED].data.foreach_set("co", posed.ravel())
        mesh.update_tag()


def _plain_material(tone: SkinTone) -> bpy.types.Material:
    """Patches of warmth and pallor, and a fine grain; no folds and no nails, which need masks."""
    material = bpy.data.materials.new("plain skin")
    if bpy.app.version < (5, 0, 0):  # later ones have nodes at once, and warn
        material.use_nodes = True
    graph = NodeGraph(material.node_tree)
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
    shader = material.node_tree.nodes["Principled BSDF"]
    for name, value in inputs.items():
        graph.connect(value, shader.inputs[name])
    return material
