"""`livehand make-hand`: arguments, and the call."""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("character", type=Path, help="a skinned hand or character: .blend, .glb, .gltf or .fbx")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="NPZ",
        help="the hand model; its look becomes a .blend beside",
    )
    parser.add_argument("--armature", metavar="NAME", help="which one (default: the only one that moves a mesh)")
    parser.add_argument("--mesh", metavar="NAME", help="which one (default: the one that the fingers move most of)")
    parser.add_argument("--side", choices=("right", "left"), help="which hand (default: as the bones tell)")
    parser.add_argument(
        "--bones", type=Path, metavar="JSON", help="which bone is which joint (default: by their names)"
    )
    parser.add_argument("--scale", type=float, default=1.0, help="multiplied by this, the file's lengths are metres")


def run(args: argparse.Namespace) -> dict:
    """Make the hand; returns what was made."""
    import bpy

    from .character_file import find_armature, find_mesh, joint_map_of, open_character
    from .hand_from_mesh import make_own_hand, mesh_skinned_to

    open_character(args.character)
    armature = find_armature(args.armature)
    joint_map = joint_map_of(armature, args.side, args.bones)
    mesh = find_mesh(args.mesh, armature) if args.mesh else mesh_skinned_to(armature, joint_map)
    source = {
        "source": args.character.name,
        "source_sha256": hashlib.sha256(args.character.read_bytes()).hexdigest(),
    }
    return make_own_hand(bpy.context, mesh, armature, joint_map, args.output, args.scale, source)
