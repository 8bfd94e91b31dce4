"""Animated rigs in files (BVH, FBX, glTF) for commands, read as *Import Motion* does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from ...backend.motion.motion import HandMotion
from ...backend.motion.spaces import rest_wrists
from ...backend.records.side import Side
from ...backend.system.command import warn

if TYPE_CHECKING:
    from .importing import RigFileMotion


def read_upright(path: Path, hand: HandModel, side: Side | None = None) -> HandMotion:
    """Read a file's motion with the wrist at the origin of Blender's world; what speaks against it is printed."""
    found = _read(path, hand, side)
    if found.doubt:
        warn(f"livehand render: {path}: check the motion: {found.doubt}")
    motion = found.motion
    return replace(motion, transl=-rest_wrists(hand.for_side(motion.side), motion.betas))


def rig_facts(path: Path) -> dict[str, Any]:
    """Describe what a file holds, by name."""
    found = _read(path, load_default_hand(), None)
    facts = {
        "kind": "animated rig",
        "armature": found.armature,
        "hand": found.motion.side,
        "bones": ", ".join(bone for bone in found.joint_map.bones if bone),
        "frames": len(found.motion),
        "fps": round(found.motion.fps or 0, 3),
        "scale_of_hand": round(found.shape.scale, 3),
    }
    return facts | ({"check": found.doubt} if found.doubt else {})


def _read(path: Path, hand: HandModel, side: Side | None) -> RigFileMotion:
    import bpy

    from .importing import RigFile, read_rig_file

    return read_rig_file(bpy.context, RigFile(path, side), hand)
