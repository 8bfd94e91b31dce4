"""A hand's size in the world, which its object's scale gives."""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.foreign_rig.shape_fit import HandShape


def take_shape(context: bpy.types.Context, hand: bpy.types.Object, shape: HandShape) -> None:
    """Give a hand a shape and a size; its object stays where it is."""
    hand.livehand.beta = shape.beta
    now = float(np.mean(hand.matrix_world.to_scale()))
    hand.scale = [axis * shape.scale / now for axis in hand.scale]
    hand.update_tag()
    context.view_layer.update()
