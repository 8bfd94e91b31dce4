"""A hand's size in the world, which its object's scale gives."""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.retarget.shape_fit import HandShape


def present_shape(hand: bpy.types.Object) -> HandShape:
    """The shape and the size that a hand has now."""
    return HandShape(np.array(hand.livehand.beta, np.float64), float(np.mean(hand.matrix_world.to_scale())))


def take_shape(context: bpy.types.Context, hand: bpy.types.Object, shape: HandShape) -> None:
    """Give a hand a shape and a size; its object stays where it is."""
    hand.scale = [axis * shape.scale / present_shape(hand).scale for axis in hand.scale]
    hand.livehand.beta = shape.beta
    hand.update_tag()
    context.view_layer.update()
