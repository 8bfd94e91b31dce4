"""A fingertip target that is grabbed takes its finger along: while it is moved with IK off, IK is turned on.

A cancelled move turns it off again. With IK off, a target is drawn at its fingertip, and put there when it is selected.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar, NamedTuple

import bpy
from bpy.app.handlers import persistent

from ...backend.hand.bones import FINGERS
from ..rig.fingertips import has_fingertip_targets, put_targets_at_fingertips
from ..rig.hand import RiggedHand, active_hand
from ..rig.keyframes import key_finger
from ..rig.sliders import read_slider, write_slider
from ..scene.handlers import add_handlers, remove_handlers

_INTERVAL_S = 0.1


class Grabbed(NamedTuple):
    """A finger whose IK was turned on while its target is moved, and the name of its hand."""

    hand: str
    finger: str


def grab_targets(hand: RiggedHand, selected: Iterable[str]) -> list[Grabbed]:
    """Turn IK on for the fingers whose targets are among the selected bones and whose IK is off."""
    fingers = _without_ik(hand, selected)
    for finger in fingers:
        write_slider(hand.armature, f"{finger}.ik", 1.0)
    return [Grabbed(hand.armature.name, finger) for finger in fingers]


def fetch_targets(context: bpy.types.Context, hand: RiggedHand, selected: Iterable[str]) -> None:
    """Put the targets that are among the selected bones where they are drawn, if their fingers' IK is off."""
    put_targets_at_fingertips(context, hand, _without_ik(hand, selected))


def _without_ik(hand: RiggedHand, selected: Iterable[str]) -> list[str]:
    """List the fingers whose targets are among the selected bones and whose IK is off."""
    targets = {hand.target(finger).name: finger for finger in FINGERS}
    fingers = [targets[name] for name in selected if name in targets]
    return [finger for finger in fingers if read_slider(hand.armature, f"{finger}.ik") == 0]


def release_targets(grabbed: Iterable[Grabbed], is_cancelled: bool) -> None:
    """Turn IK off again after a cancelled move; after another, key it if automatic keying is on."""
    for one in grabbed:
        armature = bpy.data.objects.get(one.hand)
        if armature is None:
            continue
        hand = RiggedHand.of(armature)
        if is_cancelled:
            write_slider(armature, f"{one.finger}.ik", 0.0)
        elif bpy.context.scene.tool_settings.use_keyframe_insert_auto:
            key_finger(hand, one.finger, bpy.context.scene.frame_current)


class _Move:
    """The move that runs, if it is one of targets: the fingers whose IK it turned on, and the operation before it."""

    grabbed: ClassVar[list[Grabbed]] = []
    last_operation = 0


@persistent
def _look(*_) -> None:
    """Look for a new move, or a newly selected target, after each change of the file."""
    armature = active_hand(bpy.context) if not _Move.grabbed else None
    if armature is not None and armature.mode == "POSE" and has_fingertip_targets(armature):
        bones = [bone.name for bone in bpy.context.selected_pose_bones or ()]
        if not _is_transforming():
            if not _is_playing():  # it would evaluate each frame a second time
                fetch_targets(bpy.context, RiggedHand.of(armature), bones)
            return
        _Move.grabbed, _Move.last_operation = grab_targets(RiggedHand.of(armature), bones), _last_operation()
        if _Move.grabbed:
            bpy.app.timers.register(_wait, first_interval=_INTERVAL_S)


def _wait() -> float | None:
    if _is_transforming():
        return _INTERVAL_S
    grabbed, _Move.grabbed = _Move.grabbed, []
    release_targets(grabbed, is_cancelled=_last_operation() == _Move.last_operation)
    return None


def _last_operation() -> int:
    operations = bpy.context.window_manager.operators
    return operations[-1].as_pointer() if operations else 0


def _is_transforming() -> bool:
    windows = bpy.context.window_manager.windows
    return any(
        operator.bl_idname.startswith("TRANSFORM_OT_") for window in windows for operator in window.modal_operators
    )


def _is_playing() -> bool:
    screen = bpy.context.screen
    return screen is not None and screen.is_animation_playing


_WATCHED = (("depsgraph_update_post", _look),)


def watch_targets() -> None:
    """Turn IK on when targets are grabbed, from now on."""
    if not bpy.app.background and "modal_operators" in bpy.types.Window.bl_rna.properties:
        add_handlers(_WATCHED)


def stop_watching() -> None:
    """Undo `watch_targets`."""
    remove_handlers(_WATCHED)
    if bpy.app.timers.is_registered(_wait):
        bpy.app.timers.unregister(_wait)
