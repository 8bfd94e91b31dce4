"""Operators that change a hand's shape, and the names of the built-in hand's ten shape coefficients."""

from __future__ import annotations

import bpy
import numpy as np
from bpy.props import FloatProperty, IntProperty

from ...backend.hand.measurements import check_has_shapes, fit_beta
from ..rig.hand import RiggedHand
from ..rig.sliders import write_slider
from .mixins import OnHand, reports_errors

# Of the built-in hand, as measured (docs/use/look.md). The coefficients of other models have no names.
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


def shape_names(properties: bpy.types.PropertyGroup) -> tuple[str, ...]:
    """Label the ten values of a hand's beta."""
    return tuple(f"Beta {k}" for k in range(10)) if properties.model_path else _NAMES


class LIVEHAND_OT_reset_shape(OnHand, bpy.types.Operator):
    """Give the hand its model's mean shape; its pose is kept."""

    bl_idname = "livehand.reset_shape"
    bl_label = "Reset Shape"
    bl_options = {"REGISTER", "UNDO"}

    @reports_errors
    def execute(self, context):
        """Set beta to zero."""
        set_beta(RiggedHand.active(context), np.zeros(10))


class LIVEHAND_OT_random_shape(OnHand, bpy.types.Operator):
    """Give the hand a random shape."""

    bl_idname = "livehand.random_shape"
    bl_label = "Random Shape"
    bl_options = {"REGISTER", "UNDO"}

    seed: IntProperty(name="Seed", description="Each seed gives another shape", min=0)
    strength: FloatProperty(
        name="Strength", description="Standard deviation of each slider", default=1.0, min=0.0, soft_max=2.0
    )

    @reports_errors
    def execute(self, context):
        """Sample beta from a normal distribution."""
        hand = RiggedHand.active(context)
        check_has_shapes(hand.model)
        set_beta(hand, np.random.default_rng(self.seed).normal(size=10) * self.strength)


class LIVEHAND_OT_match_measurements(OnHand, bpy.types.Operator):
    """Give the hand the length and breadth of a real one, by the shape closest to the mean."""

    bl_idname = "livehand.match_measurements"
    bl_label = "Match Measurements"
    bl_options = {"REGISTER", "UNDO"}

    length_mm: FloatProperty(
        name="Length",
        subtype="DISTANCE_CAMERA",
        description="From the wrist to the tip of the straight middle finger",
        default=187.0,
        min=1.0,
    )
    breadth_mm: FloatProperty(
        name="Breadth",
        subtype="DISTANCE_CAMERA",
        description="Across the knuckles, without the thumb",
        default=77.0,
        min=1.0,
    )

    def invoke(self, context, event):
        """Ask for the measurements."""
        return context.window_manager.invoke_props_dialog(self)

    @reports_errors
    def execute(self, context):
        """Fit beta."""
        hand = RiggedHand.active(context)
        beta = fit_beta(hand.model, self.length_mm / 1e3, self.breadth_mm / 1e3)
        if np.abs(beta).max() > 3:
            self.report({"WARNING"}, "The shape is far from the mean shape; avatars look best near it")
        set_beta(hand, beta)


CLASSES = (LIVEHAND_OT_reset_shape, LIVEHAND_OT_random_shape, LIVEHAND_OT_match_measurements)


def set_beta(hand: RiggedHand, beta: np.ndarray) -> None:
    """Set the shape's sliders to beta [10]."""
    write_slider(hand.armature, "beta", beta)
