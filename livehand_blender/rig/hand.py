"""A posable hand in the scene: the road from a hand model to an armature that an animator can pose."""

from __future__ import annotations

import bpy

from ...backend.hand.model import HandModel
from ...backend.records.errors import LiveHandError
from .armature import build_armature, drive_joints
from .controls import add_controls
from .fingertips import add_fingertip_targets
from .hand_mesh import build_mesh
from .limits import add_limits
from .shapes import dress


def add_hand(
    context: bpy.types.Context, model: HandModel, model_path: str = "", name: str = "LiveHand"
) -> bpy.types.Object:
    """Build a hand at the world's origin, in object mode, and return its armature, selected and active.

    Args:
        context: its collection takes the objects, its view layer must show that collection.
        model: the hand, already of the wanted side (`HandModel.for_side`).
        model_path: the file it came from, kept for whoever renders; empty for the built-in hand.
        name: of the armature; the mesh is called the same with " Mesh" behind it.

    Raises:
        LiveHandError: the context's collection is not in its view layer.
    """
    if context.object is not None and context.object.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    armature = build_armature(context, model, name)
    drive_joints(armature, model)
    add_controls(armature, model)
    add_limits(armature, model)
    add_fingertip_targets(armature, model.side)
    dress(armature, model.side)
    mesh = build_mesh(model, armature, f"{name} Mesh")
    _describe(armature, mesh, model, model_path)
    return armature


def find_hands(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The armatures of the scene's hands, by name."""
    return sorted((thing for thing in scene.objects if thing.livehand.is_hand), key=lambda thing: thing.name)


def mesh_of(armature: bpy.types.Object) -> bpy.types.Object:
    """The mesh that a hand's armature moves.

    A copy of the armature alone still points at the first hand's mesh, so the pointer counts only where it points back.

    Raises:
        LiveHandError: the hand has no mesh, or several and none is chosen.
    """
    mesh = armature.livehand.mesh
    if mesh is not None and _is_skinned_to(mesh, armature):
        return mesh
    skinned = [child for child in armature.children_recursive if _is_skinned_to(child, armature)]
    if len(skinned) != 1:
        raise LiveHandError(
            f"{armature.name} must have one mesh that it deforms, got {len(skinned)}; choose it in the LiveHand tab"
        )
    return skinned[0]


def _is_skinned_to(thing: bpy.types.Object, armature: bpy.types.Object) -> bool:
    return thing.type == "MESH" and thing.find_armature() == armature


def _describe(armature: bpy.types.Object, mesh: bpy.types.Object, model: HandModel, model_path: str) -> None:
    hand = armature.livehand
    hand.is_hand = True
    hand.side = model.side
    hand.model_path = model_path
    hand.model_sha256 = model.sha256
    hand.mesh = mesh
