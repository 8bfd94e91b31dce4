"""The sliders of a hand: custom properties of its armature, such as `hand["index.curl"]`.

Drivers read them, so that a saved file plays without LiveHand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np

from ...backend.hand.bones import FINGERS

FINGER_SLIDERS = ("curl", "spread", "ik")
_SHAPES = 10


@dataclass(frozen=True)
class Slider:
    """A number that an animator sets and keys, a switch, or the ten shape coefficients.

    Attributes:
        label: its name in panels.
        description: what it does.
        default: where it rests; its type is the slider's.
        limits: `min`, `max`, `soft_min` and `soft_max`, as Blender's properties have them.
    """

    label: str
    description: str
    default: float | bool | tuple[float, ...] = 0.0
    limits: Mapping[str, float] = field(default_factory=dict)

    def value(self, value: Any) -> float | bool | list[float]:
        """Convert a value to the slider's type: Blender would make whole numbers of a property that is given one."""
        if isinstance(self.default, tuple):
            return np.asarray(value, np.float64).tolist()
        return type(self.default)(value)


_FINGER = {
    "curl": Slider(
        "Curl",
        "Bends all joints of the finger, at 1 as in a fist; added to the bones' own rotations",
        limits={"soft_min": -0.3, "soft_max": 1.0},
    ),
    "spread": Slider(
        "Spread",
        "Spreads the finger away from its neighbors; added to the bones' own rotations",
        limits={"soft_min": -1.0, "soft_max": 1.0},
    ),
    "ik": Slider(
        "IK",
        "How far the fingertip follows its target: 0 is FK (the bones alone), 1 is IK",
        limits={"min": 0.0, "max": 1.0},
    ),
}
_HAND = {
    "fist": Slider(
        "Fist",
        "Closes the whole hand; added to the bones' own rotations",
        limits={"soft_min": 0.0, "soft_max": 1.0},
    ),
    "opposition": Slider(
        "Opposition",
        "Brings the thumb in front of the fingers; added to the bones' own rotations",
        limits={"soft_min": 0.0, "soft_max": 1.0},
    ),
    "follow": Slider(
        "Follow",
        "How far the hand follows the other rig: 0 not at all, 1 fully",
        1.0,
        {"min": 0.0, "max": 1.0},
    ),
    "limit_joints": Slider("Limit Joints", "Keep the finger joints within a hand's usual range", default=False),
    "beta": Slider(
        "Shape",
        "Shape coefficients; avatars look best near zero",
        (0.0,) * _SHAPES,
        # Blender clamps shape keys outside this range.
        {"min": -10.0, "max": 10.0, "soft_min": -3.0, "soft_max": 3.0},
    ),
}
SLIDERS = {f"{finger}.{name}": slider for finger in FINGERS for name, slider in _FINGER.items()} | _HAND


def slider_path(name: str) -> str:
    """Return the data path of a slider, or of an element of one such as `beta[3]`, from the armature."""
    slider, bracket, index = name.partition("[")
    return f'["{slider}"]{bracket}{index}'


def add_sliders(armature: bpy.types.Object) -> None:
    """Give an armature all sliders, at rest."""
    for name, slider in SLIDERS.items():
        armature[name] = slider.value(slider.default)
        interface = armature.id_properties_ui(name)
        interface.update(description=slider.description, default=slider.default, **slider.limits)
        armature.property_overridable_library_set(slider_path(name), True)


def read_slider(armature: bpy.types.Object, name: str) -> Any:
    """Read a slider of an original or an evaluated armature; its default if a user has removed it."""
    slider = SLIDERS[name]
    return slider.value(armature.get(name, slider.default))


def read_beta(armature: bpy.types.Object) -> np.ndarray:
    """Read the shape coefficients [10] of a hand."""
    return np.array(read_slider(armature, "beta"))


def write_slider(armature: bpy.types.Object, name: str, value: Any) -> None:
    """Set a slider, and tell Blender, which does not notice custom properties by itself."""
    armature[name] = SLIDERS[name].value(value)
    armature.update_tag()
