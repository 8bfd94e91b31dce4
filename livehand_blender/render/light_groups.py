"""Light groups as passes: each shows the hands in the light of one group, over Cycles' pass of that group.

A relightable hand is rendered again in the light of each group, which costs little, as the renderer keeps what no light
changes. The passes add up to Combined as far as groups hold all lights; hands that keep their capture's light belong
to no group. What Cycles has measured of all light together is shared among the groups in their proportion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import bpy
import numpy as np

from ...backend.records.frame import Frame
from ...backend.records.light import Light
from ...backend.render.composition import SceneLayer
from ...backend.render.frame_task import ExposureFrames, FrameTask, HandInstance, HandTask
from ...backend.render.picture import compose_picture
from .passes import ScenePasses

_TINY = 1e-12


@dataclass(frozen=True)
class GroupedFrames:
    """The frames of a view's hands.

    Attributes:
        samples: in all light, of every exposure sample.
        groups: name of each light group -> the same frames in its light alone.
    """

    samples: tuple[ExposureFrames, ...]
    groups: Mapping[str, tuple[ExposureFrames, ...]]


def light_groups(layer: bpy.types.ViewLayer) -> tuple[str, ...]:
    """List the names of a view layer's light groups."""
    return tuple(group.name for group in layer.lightgroups)


def pass_name(group: str) -> str:
    """Name the group's pass as Cycles does."""
    return f"Combined_{group}"


def task_with_groups(task: FrameTask, groups: Sequence[str]) -> FrameTask:
    """Follow every lit hand of the task by itself in the light of each of its groups, if any is wanted."""
    if not groups:
        return task
    return FrameTask(tuple(tuple(one for hand in hands for one in (hand, *_in_groups(hand))) for hands in task.samples))


def grouped_frames(task: FrameTask, groups: Sequence[str], samples: Sequence[ExposureFrames]) -> GroupedFrames:
    """Sort the frames of `task_with_groups(task, groups)` by group."""
    if not groups:
        return GroupedFrames(tuple(samples), {})
    split = [_split(hands, frames) for hands, frames in zip(task.samples, samples, strict=True)]
    return GroupedFrames(
        tuple(tuple(total for total, _ in hands) for hands in split),
        {name: tuple(tuple(_of_group(name, *hand) for hand in hands) for hands in split) for name in groups},
    )


def group_passes(
    frames: GroupedFrames,
    hands: Sequence[HandInstance],
    size_px: tuple[int, int],
    convert: Callable[[Frame], Frame],
    scene: ScenePasses,
) -> dict[str, np.ndarray]:
    """Map names to [H, W, 3] of each group's pass; a grade's bias, which is no light, belongs to no group.

    Args:
        frames: of the hands.
        hands: in the order of the frames.
        size_px: of the picture.
        convert: changes a frame into the scene's colours.
        scene: Cycles' passes; empty if it did not render.
    """
    unbiased = [replace(hand, grade=replace(hand.grade, bias=(0.0, 0.0, 0.0))) for hand in hands]
    passes = {}
    for name, samples in frames.groups.items():
        around = None
        if scene:
            around = SceneLayer(scene[pass_name(name)], scene["Combined"][..., 3], scene["Depth"][..., 0])
        picture = compose_picture(unbiased, samples, size_px, convert, around, None)
        passes[pass_name(name)] = picture.combined.rgb
    return passes


def _in_groups(hand: HandTask) -> list[HandTask]:
    """List the hand in the light of each of its groups, and in that of none."""
    light = hand.shot.light
    groups = _groups_of(light)
    return [replace(hand, shot=replace(hand.shot, light=light.of_group(name))) for name in groups] if light else []


def _groups_of(light: Light | None) -> tuple[str, ...]:
    return light.groups if light else ()


def _split(hands: Sequence[HandTask], frames: Sequence[Frame]) -> list[tuple[Frame, dict[str, Frame]]]:
    """Split frames into each hand's frame in all light, and by group."""
    found, rest = [], list(frames)
    for hand in hands:
        groups = _groups_of(hand.shot.light)
        total, parts, rest = rest[0], rest[1 : 1 + len(groups)], rest[1 + len(groups) :]
        found.append((total, dict(zip(groups, _sharing(total, parts), strict=True))))
    return found


def _sharing(total: Frame, parts: Sequence[Frame]) -> list[Frame]:
    """Scale the parts so that they add up to the total; where no part has light, it is shared evenly."""
    if not parts:
        return []
    whole = reduce(np.add, (part.rgb for part in parts))
    is_dark = whole <= _TINY
    factor = total.rgb / np.where(is_dark, 1, whole)
    return [replace(part, rgb=np.where(is_dark, total.rgb / len(parts), part.rgb * factor)) for part in parts]


def _of_group(name: str, total: Frame, parts: Mapping[str, Frame]) -> Frame:
    """Return the frame in a group's light; black where none of it falls on the hand."""
    return parts[name] if name in parts else replace(total, rgb=np.zeros_like(total.rgb))
