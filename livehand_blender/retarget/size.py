"""A hand's shape, and its size in the world, which is its object's scale."""

from __future__ import annotations

import bpy
import numpy as np

from ...backend.retarget.shape_fit import HandShape
from ..rig.hand import RiggedHand


def current_shape(hand: RiggedHand) -> HandShape:
    """A hand's present shape and size."""
    scale = float(np.mean(hand.armature.matrix_world.to_scale()))
    return HandShape(np.array(hand.properties.beta, np.float64), scale)


def set_shape(context: bpy.types.Context, hand: RiggedHand, shape: HandShape) -> None:
    """Give a hand a shape and a size; its object's location is unchanged."""
    armature = hand.armature
    armature.scale = [axis * shape.scale / current_shape(hand).scale for axis in armature.scale]
    armature.livehand.beta = shape.beta
    armature.update_tag()
    context.view_layer.update()
