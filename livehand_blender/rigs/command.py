"""`livehand make-hand`: arguments, and the call."""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("character", type=Path, help="a skinned hand or character: .blend, .glb, .gltf, .vrm or .fbx")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="NPZ",
        help="the hand model; its materials are saved as a .blend beside it",
    )
    parser.add_argument("--armature", metavar="NAME", help="the armature (default: the only one that deforms a mesh)")
    parser.add_argument(
        "--mesh", metavar="NAME", help="the hand's mesh (default: the one with the most vertices moved by the fingers)"
    )
    parser.add_argument("--side", choices=("right", "left"), help="which hand (default: the one with more bones)")
    parser.add_argument("--bones", type=Path, metavar="JSON", help="which bone is which joint (default: guess)")
    parser.add_argument("--scale", type=float, default=1.0, help="factor from the file's lengths to meters")
    parser.add_argument("--overwrite", action="store_true", help="replace the files of a hand of that name")
    parser.add_argument("--no-look", action="store_true", help="write no .blend with the materials")


def run(args: argparse.Namespace) -> dict:
    """Make the hand model; returns facts about it."""
    import bpy

    from .character_file import find_armature, find_mesh, open_character, read_joint_map
    from .hand_from_mesh import hand_model_from_mesh, mesh_skinned_to

    open_character(args.character)
    armature = find_armature(args.armature)
    joint_map = read_joint_map(armature, args.side, args.bones)
    mesh = find_mesh(args.mesh, armature) if args.mesh else mesh_skinned_to(armature, joint_map)
    source = {
        "source": args.character.name,
        "source_sha256": hashlib.sha256(args.character.read_bytes()).hexdigest(),
    }
    wishes = {"overwrites": args.overwrite, "has_materials": not args.no_look}
    return hand_model_from_mesh(bpy.context, mesh, armature, joint_map, args.output, args.scale, source, **wishes)
