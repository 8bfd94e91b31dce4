"""From a skinned mesh to a hand model's file, and the .blend with its materials (its look)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...backend.hand.model_file import load_hand_model
from ...backend.records.errors import LiveHandError
from ...backend.rigs.doubts import rest_doubts
from ...backend.rigs.hand_from_mesh.hand_model import check_name, make_hand_model, save_hand_model
from ...backend.rigs.source_skeleton import JointMap
from ..capture.hand_materials import materials_path
from .character_file import skinned_meshes
from .materials_file import save_materials
from .rest_mesh import read_rest_mesh
from .source import read_skeleton


def hand_model_from_mesh(
    context: bpy.types.Context,
    mesh: bpy.types.Object,
    armature: bpy.types.Object,
    joint_map: JointMap,
    path: Path,
    scale: float = 1.0,
    provenance: Mapping[str, Any] | None = None,
    overwrites: bool = False,
    has_materials: bool = True,
) -> dict[str, Any]:
    """Write `path` (.npz) and the .blend beside it, or neither; returns facts about the hand model.

    Args:
        context: with the scene of the mesh.
        mesh: skinned.
        armature: its bones.
        joint_map: which bones are the hand's joints.
        path: of the hand model.
        scale: factor from the scene's lengths to metres.
        provenance: further facts for the file.
        overwrites: replace another hand's files.
        has_materials: write the .blend.

    Raises:
        LiveHandError: the mesh is not a hand that can be rendered, a file exists already, or one cannot be written.
    """
    check_name(path, joint_map.side)
    _check_free(path, overwrites, has_materials)
    skeleton = read_skeleton(armature)
    rest = read_rest_mesh(context, mesh, armature, skeleton)
    waiting = path.with_name(f"{path.stem}.waiting.npz")  # until its look is written, too
    try:
        hand = make_hand_model(rest.surface, skeleton, joint_map, scale)
        origin = {
            "made_by": "livehand make-hand",
            "mesh": mesh.name,
            "armature": armature.name,
            "scale": scale,
            "side": joint_map.side,
            "bones": list(joint_map.bones),
        }
        save_hand_model(hand, waiting, {**origin, **(provenance or {})})
        model = load_hand_model(waiting, joint_map.side)
        missing = save_materials(materials_path(path), mesh, rest, hand, model.sha256) if has_materials else []
        waiting.replace(path)
    finally:
        bpy.data.meshes.remove(rest.data)
        waiting.unlink(missing_ok=True)
    return {
        "hand": str(path),
        "look": str(materials_path(path)) if has_materials else None,
        "pictures_missing": missing,
        "side": model.side,
        "vertices": len(model.v_template),
        "faces": len(model.f),
        "length_mm": round(1e3 * float(np.ptp(model.v_template[:, 0])), 1),
        "pieces_left_out": hand.cut.other_pieces,
        "joints_without_bones": list(joint_map.missing),
        "doubt": rest_doubts(hand.alignment, scale),
        "subdivision_moves_mm": round(1e3 * scale * float(rest.smoothed_m[hand.cut.source].max()), 2),
    }


def _check_free(path: Path, overwrites: bool, has_materials: bool) -> None:
    """Raise `LiveHandError` if a file of somebody else's would be replaced."""
    blend = materials_path(path)
    is_own_source = bool(bpy.data.filepath) and blend.resolve() == Path(bpy.data.filepath).resolve()
    is_others_blend = blend.exists() and not path.exists()
    if has_materials and (is_own_source or is_others_blend):
        raise LiveHandError(
            f"{blend.name} beside the hand model must be free for the hand's materials, it is a file of yours; give "
            "the model another name"
        )
    for taken in (path, *([blend] if has_materials else [])):
        if taken.exists() and not overwrites:
            raise LiveHandError(
                f"{taken} exists already, and avatars may have been trained for it; give another name, or --overwrite"
            )


def mesh_skinned_to(armature: bpy.types.Object, joint_map: JointMap) -> bpy.types.Object:
    """Find the armature's mesh with vertices in the most of the joints' groups; of equals, more in the fingers' groups.

    Raises:
        LiveHandError: there is none.
    """
    fingers = {bone for bone in joint_map.bones[1:] if bone}
    best = max(skinned_meshes(armature), key=lambda mesh: _group_and_vertex_count(mesh, fingers), default=None)
    if best is None or not any(_group_and_vertex_count(best, fingers)):
        raise LiveHandError(f"a mesh must be skinned to the fingers' bones of '{armature.name}', none is")
    return best


def _group_and_vertex_count(mesh: bpy.types.Object, names: set[str]) -> tuple[int, int]:
    """Count the named vertex groups that have vertices, and how many vertices they have."""
    groups = {group.index for group in mesh.vertex_groups if group.name in names}
    own = [{element.group for element in vertex.groups} & groups for vertex in mesh.data.vertices]
    return len(set().union(*own)), sum(map(bool, own))
