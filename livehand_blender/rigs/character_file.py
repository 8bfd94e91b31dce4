"""A character in a file that Blender opens or imports (.blend, glTF, FBX): its armature, and the hand's mesh."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import bpy

from ...backend.hand.model import JOINT_NAMES
from ...backend.records.errors import LiveHandError
from ...backend.records.side import Side
from ...backend.rigs.joint_guess import guess_joints
from ...backend.rigs.source_skeleton import JointMap
from ...backend.system.readers import read_json
from ..scene.file_paths import operator_path
from .importing import import_rig
from .pictures import find_pictures
from .source import read_skeleton

_KINDS = (".blend", ".glb", ".gltf", ".vrm", ".fbx")


def open_character(path: Path) -> None:
    """Open the file's scene.

    Raises:
        LiveHandError: the file does not exist, is of another kind, or Blender cannot read it.
    """
    if not path.is_file():
        raise LiveHandError(f"no character at {path}; give a .blend, .glb, .gltf, .vrm or .fbx")
    suffix = path.suffix.lower()
    if suffix not in _KINDS:
        raise LiveHandError(
            f"a character must be a .blend, .glb, .gltf, .vrm or .fbx, got {path.name}; export it in one of "
            "these formats"
        )
    if suffix != ".blend":
        bpy.ops.wm.read_homefile(use_empty=True)
        import_rig(path)
    else:
        open_blend(path)
    find_pictures(path.resolve().parent)
    bpy.context.view_layer.update()


def open_blend(path: Path) -> None:
    """Open a .blend, without running its scripts.

    Raises:
        LiveHandError: it does not exist, or Blender cannot read it.
    """
    if not path.is_file():
        raise LiveHandError(f"no .blend at {path}; give the path of a saved one")
    try:
        bpy.ops.wm.open_mainfile(filepath=operator_path(path), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise LiveHandError(f"Blender must be able to read {path} ({str(error).strip()})") from error


def find_armature(name: str | None) -> bpy.types.Object:
    """Find the scene's armature of a name, or the only one that deforms a mesh.

    Raises:
        LiveHandError: there is none, or several and no name was given.
    """
    armatures = [thing for thing in bpy.context.scene.objects if thing.type == "ARMATURE"]
    if name is None:
        armatures = [thing for thing in armatures if skinned_meshes(thing)]
    else:
        armatures = [thing for thing in armatures if thing.name == name]
    return _only(armatures, "armature", "--armature", name)


def find_mesh(name: str, armature: bpy.types.Object) -> bpy.types.Object:
    """Find the mesh of a name, which the armature must deform.

    Raises:
        LiveHandError: there is none.
    """
    meshes = [mesh for mesh in skinned_meshes(armature) if mesh.name == name]
    return _only(meshes, f"mesh of '{armature.name}'", "--mesh", name)


def skinned_meshes(armature: bpy.types.Object) -> list[bpy.types.Object]:
    """List the scene's meshes that an armature deforms."""
    return [thing for thing in bpy.context.scene.objects if thing.type == "MESH" and thing.find_armature() == armature]


def read_joint_map(armature: bpy.types.Object, side: Side | None, bones: Path | None) -> JointMap:
    """Read the bones that are a hand's joints from a file, or guess them.

    Args:
        armature: that has the bones.
        side: which hand; None: the one that the file names, or the one with more bones.
        bones: JSON, {"side": "right", "wrist": "Bone", "index1": "Bone.001", ...}; None: guess. Joints that it leaves
            out have no bone.

    Raises:
        LiveHandError: there is no hand, or too little of one.
    """
    if bones is not None:
        return _read_map(bones, side)
    return guess_joints(read_skeleton(armature), side, is_determined=side is not None).joint_map()


def _read_map(path: Path, side: Side | None) -> JointMap:
    try:
        named = read_json(path)
    except LiveHandError as error:
        raise LiveHandError(f'{path} must be JSON like {{"wrist": "Bone", ...}} ({error})') from error
    if not isinstance(named, dict) or not all(isinstance(value, str) for value in named.values()):
        raise LiveHandError(f"{path} must map the names of joints to names of bones, got {str(named)[:60]}")
    unknown = sorted(set(named) - {"side", *JOINT_NAMES})
    if unknown:
        raise LiveHandError(f"{path} may name {', '.join(JOINT_NAMES)} and side, got {', '.join(unknown)}")
    side = side or named.get("side", "right")
    if side not in get_args(Side):
        raise LiveHandError(f"{path}: side must be right or left, got {side!r}")
    return JointMap(side, tuple(named.get(joint) for joint in JOINT_NAMES))


def _only(found: list[bpy.types.Object], kind: str, option: str, name: str | None) -> bpy.types.Object:
    if len(found) == 1:
        return found[0]
    if name is not None:
        raise LiveHandError(
            f"the file must have the {kind} '{name}', it has none of that name; give another with {option}"
        )
    names = ", ".join(thing.name for thing in found) or "none"
    raise LiveHandError(f"the file must have one {kind} that deforms a mesh, got {names}; choose one with {option}")
