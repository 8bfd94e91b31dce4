"""The active hand, and what operators and panels that need one have in common."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand, load_hand_model


def active_hand(context: bpy.types.Context) -> bpy.types.Object | None:
    """The hand's armature that is active, or whose mesh is, or None."""
    active = context.active_object
    candidates = (active, active and active.parent)
    return next((thing for thing in candidates if thing is not None and thing.livehand.is_hand), None)


def polled_hand(context: bpy.types.Context) -> bpy.types.Object:
    """The active hand, where a poll has found one."""
    armature = active_hand(context)
    assert armature is not None
    return armature


def model_of(armature: bpy.types.Object) -> tuple[HandModel, Path | None]:
    """A hand's model, and the file it came from, seen from the file that the hand is in; None for the built-in hand.

    Raises:
        LiveHandError: the file is no hand model.
    """
    path = armature.livehand.model_path
    if not path:
        return load_default_hand(), None
    file = Path(bpy.path.abspath(path, library=armature.library))
    return load_hand_model(file), file


class OnHand:
    """Of operators."""

    @classmethod
    def poll(cls, context):
        """Only on a hand."""
        if active_hand(context) is None:
            cls.poll_message_set("select a LiveHand hand first")
            return False
        return True


class Tab:
    """Of panels: the LiveHand tab in the 3D view's sidebar."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "LiveHand"


class HandTab(Tab):
    """Of panels below *Hand*."""

    bl_parent_id = "LIVEHAND_PT_hand"

    @classmethod
    def poll(cls, context):
        """Only on a hand."""
        return active_hand(context) is not None
