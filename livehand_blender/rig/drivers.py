"""Drivers that Blender evaluates without running Python, so that they work in files whose scripts are not trusted.

Blender evaluates sums of products itself ("simple expressions"). An expression has at most 255 characters.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import bpy

from .sliders import slider_path

_MAX_EXPRESSION = 255
# Bone offsets (m per unit of beta) are of order 1e-3, key values of order 1: smaller terms are rounding errors.
_NEGLIGIBLE = 1e-9


class BoneTurn(NamedTuple):
    """A bone's own rotation about its axis X, Y or Z, rad."""

    bone: str
    axis: str


NO_TURNS: Mapping[BoneTurn, float] = MappingProxyType({})


def drive_by_beta(owner: bpy.types.bpy_struct, channel: str, index: int, weights, armature: bpy.types.Object) -> None:
    """Drive a channel by the weighted sum [10] of the hand's beta; index -1 if the channel is not an array."""
    drive_by_sliders(owner, channel, index, {f"beta[{k}]": float(w) for k, w in enumerate(weights)}, armature)


def drive_by_sliders(
    owner: bpy.types.bpy_struct,
    channel: str,
    index: int,
    weights: Mapping[str, float],
    armature: bpy.types.Object,
    turned: Mapping[BoneTurn, float] = NO_TURNS,
) -> None:
    """Drive a channel by a weighted sum of the hand's sliders, named like `beta[3]` or `index.curl`, and of turns.

    Sliders of weight zero are left out; if none remains, no driver is made.
    """
    paths = {f"b{k}": path for k, path in enumerate(weights)}
    turns = {f"m{k}": turn for k, turn in enumerate(turned)}
    weights_by_name = {name: weights[path] for name, path in paths.items()}
    expression, names = weighted_sum(weights_by_name | {name: turned[turn] for name, turn in turns.items()})
    if not names:
        return
    driver = _new_driver(owner, channel, index, expression)
    for name in names:
        variable = driver.variables.new()
        variable.name = name
        target = variable.targets[0]
        if name in turns:
            variable.type = "TRANSFORMS"
            target.bone_target, target.transform_type = turns[name].bone, f"ROT_{turns[name].axis}"
            target.rotation_mode, target.transform_space = "XYZ", "LOCAL_SPACE"
            target.id = armature
        else:
            target.id = armature
            target.data_path = slider_path(paths[name])
            # If the user has removed a slider, what else drives the channel still counts.
            target.use_fallback_value, target.fallback_value = True, 0.0


def drive_by_rotation(
    owner: bpy.types.bpy_struct, channel: str, terms: Mapping[str, float], armature: bpy.types.Object, bone: str
) -> None:
    """Drive a channel by a weighted sum of products of a bone's local quaternion, in any rotation mode, constrained."""
    expression, names = weighted_sum(terms)
    driver = _new_driver(owner, channel, -1, expression)
    for name in names:
        variable = driver.variables.new()
        variable.name, variable.type = name, "TRANSFORMS"
        target = variable.targets[0]
        target.id, target.bone_target = armature, bone
        target.transform_type, target.rotation_mode = f"ROT_{name.upper()}", "QUATERNION"
        target.transform_space = "LOCAL_SPACE"


def weighted_sum(terms: Mapping[str, float]) -> tuple[str, list[str]]:
    """Write the expression of a sum of weight * product, and the sorted names of its variables."""
    kept = {product: weight for product, weight in terms.items() if abs(weight) > _NEGLIGIBLE}
    expression = "+".join(f"{weight:.7g}*{product}" for product, weight in kept.items()).replace("+-", "-")
    assert len(expression) <= _MAX_EXPRESSION, expression
    return expression, sorted({name for product in kept for name in product.split("*")})


def _new_driver(owner: bpy.types.bpy_struct, channel: str, index: int, expression: str) -> bpy.types.Driver:
    curve = owner.driver_add(channel, index)
    # Blender 5 maps a new driver through two keys, which drops values below 1e-4; without keys values are unchanged.
    curve.keyframe_points.clear()
    for modifier in list(curve.modifiers):
        curve.modifiers.remove(modifier)
    driver = curve.driver
    driver.type = "SCRIPTED"
    driver.expression = expression
    return driver
