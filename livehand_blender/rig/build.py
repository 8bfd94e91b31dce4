"""Builds a hand: from a hand model to an armature that an animator can pose."""

from __future__ import annotations

import bpy

from ...backend.hand.model import HandModel
from .armature import build_armature, drive_joints
from .controls import add_controls
from .fingertips import add_fingertip_targets
from .hand_mesh import build_mesh
from .limits import add_limits
from .shapes import set_bone_shapes
from .sliders import add_sliders


def add_hand(
    context: bpy.types.Context, model: HandModel, model_path: str = "", name: str = "LiveHand"
) -> bpy.types.Object:
    """Build a hand at the world's origin, in object mode, and return its armature, selected and active.

    Args:
        context: the objects are linked to its collection, which must be in its view layer.
        model: the hand, already of the wanted side (`HandModel.for_side`).
        model_path: the file it came from, saved for the renderer; empty for the built-in hand.
        name: of the armature; the mesh gets the same name followed by " Mesh".

    Raises:
        LiveHandError: the context's collection is not in its view layer.
    """
    if context.object is not None and context.object.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    armature = build_armature(context, model, name)
    add_sliders(armature)
    drive_joints(armature, model)
    add_controls(armature, model)
    add_limits(armature, model)
    add_fingertip_targets(armature, model.side)
    set_bone_shapes(armature, model.side)
    properties = armature.livehand
    properties.mesh = build_mesh(model, armature, f"{name} Mesh")
    properties.is_hand, properties.side = True, model.side
    properties.model_path, properties.model_sha256 = model_path, model.sha256
    return armature
