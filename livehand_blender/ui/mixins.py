"""What operators and panels share: where they are shown, when they are enabled, and how they report errors."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ClassVar

import bpy
from bpy.props import BoolProperty, IntProperty

from ...backend.records.errors import LiveHandError
from ...backend.system.packages import missing_requirements
from ...backend.tracking.weights import has_networks
from ..rig.hand import active_hand

SIDES = (("right", "Right", "A right hand"), ("left", "Left", "A left hand"))


def polled_hand(context: bpy.types.Context) -> bpy.types.Object:
    """Return the active hand's armature, in a panel or operator whose `poll` has succeeded."""
    armature = active_hand(context)
    assert armature is not None
    return armature


def reports_errors(execute: Callable[..., None]) -> Callable[..., set[str]]:
    """Make an operator's `execute` return FINISHED, or report a LiveHandError and return CANCELLED."""

    @functools.wraps(execute)
    def reporting(self, context):
        try:
            execute(self, context)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}

    return reporting


class OnHand:
    """Mixin of operators that need an active hand."""

    poll_message_set: ClassVar[Callable[[str], None]]

    @classmethod
    def poll(cls, context):
        """Enable it if a hand is active."""
        if active_hand(context) is None:
            cls.poll_message_set("Select a LiveHand hand first")
            return False
        return True


class NeedsTracker:
    """Mixin of operators that track hands."""

    poll_message_set: ClassVar[Callable[[str], None]]

    @classmethod
    def poll(cls, context):
        """Enable it once the packages and the tracker's networks are there."""
        if missing_requirements():
            cls.poll_message_set("Python packages are missing: press Install Packages at the top of the LiveHand tab")
            return False
        if not has_networks():
            cls.poll_message_set("The hand tracker is missing: press Get Hand Tracker in the Video panel")
            return False
        return True


class FrameRange:
    """Mixin of operators that work on a range of frames."""

    layout: bpy.types.UILayout

    use_scene_range: BoolProperty(name="Scene Range", description="Use the scene's first to last frame", default=True)
    first: IntProperty(name="First", description="First frame", default=1)
    last: IntProperty(name="Last", description="Last frame", default=250)

    def frames(self, scene: bpy.types.Scene) -> range:
        """Return the chosen frames.

        Raises:
            LiveHandError: the last frame lies before the first.
        """
        first, last = (scene.frame_start, scene.frame_end) if self.use_scene_range else (self.first, self.last)
        if last < first:
            raise LiveHandError(f"the last frame must not lie before the first, got {first} to {last}")
        return range(first, last + 1)

    def draw(self, context):
        """Draw the frames, of which the last two are inactive if the scene's range is used."""
        self.layout.use_property_split = True
        self.layout.prop(self, "use_scene_range")
        column = self.layout.column(align=True)
        column.active = not self.use_scene_range
        column.prop(self, "first")
        column.prop(self, "last")


class Tab:
    """Mixin of panels in the LiveHand tab of the 3D view's sidebar."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "LiveHand"


class OfHand:
    """Mixin of panels that need an active hand."""

    @classmethod
    def poll(cls, context):
        """Show it if a hand is active."""
        return active_hand(context) is not None


class AdvancedTab(Tab):
    """Mixin of panels below *Advanced*."""

    bl_parent_id = "LIVEHAND_PT_advanced"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}


class HandTab(OfHand, AdvancedTab):
    """Mixin of panels below *Advanced* that need an active hand."""
