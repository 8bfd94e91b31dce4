"""Operators that change a hand's shape, and the names of the built-in hand's ten directions."""

from __future__ import annotations

import bpy
import numpy as np
from bpy.props import FloatProperty, IntProperty

from ...backend.hand.measurements import check_has_shapes, fit_beta
from ...backend.hand.model import HandModel
from ...backend.records.errors import LiveHandError
from .active_hand import OnHand, model_of, polled_hand

# Of the built-in hand, as measured (docs/hand.md). Another model's directions have no names.
_NAMES = (
    "Size",
    "Thickness",
    "Finger Length",
    "Palm Breadth",
    "Palm Depth",
    "Thumb Length",
    "Little Finger Length",
    "Index to Ring",
    "Fingertip Thickness",
    "Thumb and Palm Pads",
)


def shape_names(hand: bpy.types.PropertyGroup) -> tuple[str, ...]:
    """Ten labels for a hand's beta."""
    return tuple(f"Beta {k}" for k in range(10)) if hand.model_path else _NAMES


class LIVEHAND_OT_reset_shape(OnHand, bpy.types.Operator):
    """Give the hand its model's mean shape; its pose is kept."""

    bl_idname = "livehand.reset_shape"
    bl_label = "Reset Shape"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Zero beta."""
        return _set_shape(context, np.zeros(10))


class LIVEHAND_OT_random_shape(OnHand, bpy.types.Operator):
    """Give the hand the shape of another person."""

    bl_idname = "livehand.random_shape"
    bl_label = "Random Shape"
    bl_options = {"REGISTER", "UNDO"}

    seed: IntProperty(name="Seed", description="Each seed is a shape", min=0)
    strength: FloatProperty(
        name="Strength", description="Standard deviation of each slider", default=1.0, min=0.0, soft_max=2.0
    )

    def execute(self, context):
        """Draw beta."""
        try:
            check_has_shapes(_shown_model(polled_hand(context)))
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return _set_shape(context, np.random.default_rng(self.seed).normal(size=10) * self.strength)


class LIVEHAND_OT_match_measurements(OnHand, bpy.types.Operator):
    """Give the hand the length and breadth of a real one, by the shape nearest to the mean that has them."""

    bl_idname = "livehand.match_measurements"
    bl_label = "Match Measurements"
    bl_options = {"REGISTER", "UNDO"}

    length_mm: FloatProperty(
        name="Length (mm)",
        description="From the wrist to the tip of the straight middle finger",
        default=187.0,
        min=1.0,
    )
    breadth_mm: FloatProperty(
        name="Breadth (mm)", description="Across the knuckles, without the thumb", default=77.0, min=1.0
    )

    def invoke(self, context, event):
        """Ask for the measurements."""
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context):
        """Fit beta."""
        try:
            beta = fit_beta(_shown_model(polled_hand(context)), self.length_mm / 1e3, self.breadth_mm / 1e3)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if np.abs(beta).max() > 3:
            self.report({"WARNING"}, "the shape lies far from the mean one; the trained look fits best near zero")
        return _set_shape(context, beta)


CLASSES = (LIVEHAND_OT_reset_shape, LIVEHAND_OT_random_shape, LIVEHAND_OT_match_measurements)


def _shown_model(armature: bpy.types.Object) -> HandModel:
    return model_of(armature)[0].for_side(armature.livehand.side)


def _set_shape(context: bpy.types.Context, beta: np.ndarray) -> set[str]:
    armature = polled_hand(context)
    armature.livehand.beta = beta
    armature.update_tag()
    return {"FINISHED"}
