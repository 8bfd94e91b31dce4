"""The sliders of a hand: custom properties of its armature, which the drivers read without LiveHand.

They have the names by which scripts know them: `hand.livehand.index.curl` is `hand["index.curl"]`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatProperty, FloatVectorProperty

from ...backend.hand.bones import FINGERS

FINGER_SLIDERS = ("curl", "spread", "ik")
FORWARD = "livehand."
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
        """A value of the slider's type: Blender would make whole numbers of a property that is given one."""
        if isinstance(self.default, tuple):
            return np.asarray(value, np.float64).tolist()
        return type(self.default)(value)

    def forward(self, name: str) -> Any:
        """A Blender property that reads and writes the slider; it overrides, as those of earlier versions did."""
        makers = {bool: BoolProperty, float: FloatProperty, tuple: FloatVectorProperty}
        size = {"size": len(self.default)} if isinstance(self.default, tuple) else {}
        return makers[type(self.default)](
            name=self.label,
            description=self.description,
            default=self.default,
            override={"LIBRARY_OVERRIDABLE"},
            get=lambda group: read_slider(group, name),
            set=lambda group, value: write_slider(group, name, value),
            update=evaluate_again,
            **size,
            **self.limits,
        )


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
    """The data path of a slider, or of an element of one such as `beta[3]`, from the armature."""
    slider, bracket, index = name.partition("[")
    return f'["{slider}"]{bracket}{index}'


def slider_property(armature: bpy.types.Object, name: str) -> tuple[bpy.types.bpy_struct, str]:
    """The owner and the name of a slider's property, for panels; linked hands of earlier versions forward theirs."""
    return (armature, slider_path(name)) if name in armature else _owner(armature, name)


def add_sliders(armature: bpy.types.Object) -> None:
    """Give an armature sliders; a hand of an earlier version keeps its values."""
    values = {name: read_slider(*_owner(armature, name)) for name in SLIDERS}
    armature.livehand.has_sliders = True
    for name, slider in SLIDERS.items():
        armature[name] = values[name]
        interface = armature.id_properties_ui(name)
        interface.update(description=slider.description, default=slider.default, **slider.limits)
        armature.property_overridable_library_set(slider_path(name), True)


def has_all_sliders(armature: bpy.types.Object) -> bool:
    """Whether no slider is missing: earlier versions had none, and a user may remove any custom property."""
    return all(name in armature for name in SLIDERS)


def read_slider(group: bpy.types.PropertyGroup, name: str) -> Any:
    """The value of the slider that a group of `Object.livehand` has under this name."""
    store, key = _store(group, name)
    value = store.get(key) if store is not None else None
    slider = SLIDERS[_full_name(group, name)]
    return slider.value(slider.default if value is None else value)


def write_slider(group: bpy.types.PropertyGroup, name: str, value: Any) -> None:
    """Set that slider."""
    store, key = _store(group, name, creates=True)
    store[key] = SLIDERS[_full_name(group, name)].value(value)
    Animated.by_forward |= group.id_data.is_evaluated and store == group.id_data


class Animated:
    """Whether Blender has animated a slider by its name in `Object.livehand`, on which the drivers do not wait."""

    by_forward = False


def forwards() -> Iterator[tuple[bool, str, Any]]:
    """(whether it is a finger's, name, property) of everything that `Object.livehand` forwards to sliders."""
    for name, slider in _FINGER.items():
        yield True, name, slider.forward(name)
    for name, slider in _HAND.items():
        yield False, name, slider.forward(name)


def evaluate_again(group: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Tell Blender, which does not notice it, that a property was written by a script."""
    group.id_data.update_tag()


def _full_name(group: bpy.types.PropertyGroup, name: str) -> str:
    return f"{group.path_from_id()}.{name}".removeprefix(FORWARD)


def _owner(armature: bpy.types.Object, name: str) -> tuple[bpy.types.PropertyGroup, str]:
    """The group that forwards a slider, and its name there."""
    finger, _, last = name.rpartition(".")
    return getattr(armature.livehand, finger) if finger else armature.livehand, last


def _store(group: bpy.types.PropertyGroup, name: str, creates: bool = False) -> tuple[Any, str]:
    """What holds a slider's value, and its key there: the armature, or the group on hands of earlier versions."""
    if group.id_data.livehand.has_sliders:
        return group.id_data, _full_name(group, name)
    if hasattr(group, "bl_system_properties_get"):  # from Blender 5.0 on
        return group.bl_system_properties_get(do_create=creates), name
    return group, name
