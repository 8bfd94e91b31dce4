"""Takes of a .blend and of an animated rig in a file, and a take onto a character's file: `livehand export`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...backend.hand.model_file import DEFAULT_HAND, load_hand_model
from ...backend.records.errors import LiveHandError
from ...backend.records.side import SIDES
from ...backend.system.command import warn
from ...backend.system.files import replacing

if TYPE_CHECKING:
    import bpy

    from ...backend.motion.writers.take import Take, TakenHand
    from .sending import Sent


def take_of_blend(args: argparse.Namespace) -> Take:
    """Sample the hands of a .blend's scene.

    Raises:
        LiveHandError: Blender cannot read it, it has no hand, or more than one of a side.
    """
    import bpy

    from ..motion.taking import sample_take
    from ..rig.hand import RiggedHand, find_hands
    from .character_file import open_blend

    open_blend(args.source)
    hands = [RiggedHand.of(armature) for armature in find_hands(bpy.context.scene)]
    chosen = [hand for hand in hands if args.side in (None, hand.side)]
    if not chosen:
        raise LiveHandError(f"{args.source} must have a {args.side or 'LiveHand'} hand, got {len(hands)} other hands")
    scene = bpy.context.scene
    return sample_take(bpy.context, chosen, args.frames or range(scene.frame_start, scene.frame_end + 1))


def take_of_rig(args: argparse.Namespace) -> Take:
    """Read the hands of an animated rig in a file (BVH, FBX, glTF).

    Raises:
        LiveHandError: it cannot be read, or has no hand.
    """
    import bpy

    from ...backend.motion.writers.take import TakenHand, take_of
    from .importing import RigFile, read_rig_file

    model = load_hand_model(args.hand or DEFAULT_HAND)
    found, refused = [], []
    for side in [args.side] if args.side else SIDES:
        try:
            found.append(read_rig_file(bpy.context, RigFile(args.source, side, fps=args.fps), model))
        except LiveHandError as error:
            refused.append(error)
    if not found:
        raise refused[0]
    hands = []
    for one in found:
        if one.doubt:
            warn(f"livehand export: {args.source}: check the {one.motion.side} hand: {one.doubt}")
        hands.append(TakenHand(one.motion, model, one.shape.scale))
    return take_of(hands, args.fps or hands[0].motion.fps or 0.0)


def send_to_character(args: argparse.Namespace, take: Take) -> dict[str, Any]:
    """Key the hands of a character in a .blend with a take, and write it to the output.

    Raises:
        LiveHandError: the character cannot be read, has no such hand, or cannot have the keys. No file is written then.
    """
    import bpy

    from .character_file import find_armature, open_character

    name, _, armature_name = args.rig.partition(".blend:")
    path = Path(f"{name}.blend") if armature_name else Path(args.rig)
    if args.output.suffix.lower() != ".blend":
        raise LiveHandError(f"a character with keys must be written to a .blend, got {args.output.name}; rename it")
    open_character(path)
    armature = find_armature(armature_name or None)
    sent = {hand.side: _send(args, armature, hand, take.fps) for hand in take.hands}
    with replacing(args.output) as temporary:
        temporary.unlink()  # else Blender keeps the empty file as a backup
        bpy.ops.wm.save_as_mainfile(filepath=str(temporary.absolute()), copy=True, check_existing=False)
    for side, one in sent.items():
        if one.doubt:
            warn(f"livehand export: check the {side} hand of {armature.name}: {one.doubt}")
    frames = max(one.frames for one in sent.values())
    return {
        "output": str(args.output),
        "armature": armature.name,
        "hands": {side: {"bones": one.bones, "worst_deg": round(one.worst_deg, 3)} for side, one in sent.items()},
        "frames": frames,
        "summary": f"{args.output}: {frames} frames of {' and '.join(sent)} onto {armature.name}",
    }


def _send(args: argparse.Namespace, armature: bpy.types.Object, hand: TakenHand, fps: float) -> Sent:
    import bpy

    from .aimed_bones import with_twists
    from .character_file import read_joint_map
    from .sending import send_at_rate
    from .source import SourceRig

    rig = SourceRig(armature, with_twists(armature, read_joint_map(armature, hand.side, args.bones)))
    return send_at_rate(bpy.context, hand, rig, fps, bpy.context.scene.frame_start, arm=args.arm or "FK")
