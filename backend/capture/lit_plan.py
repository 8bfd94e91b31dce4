"""The plan of a lit capture: every image of a dome capture gets a light of its own, drawn from the seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, get_args

import numpy as np

from .capture import CaptureView, Split
from .lights import CaptureLight
from .varied_light import HELD_OUT_KINDS, LightDrawing, light_groups

_OCCLUDER_STEP, _FIRST_OCCLUDED = 8, 3
"""Every eighth training image has a slab or a wall."""


class LitViews(NamedTuple):
    """Views, and the lights that they refer to."""

    views: tuple[CaptureView, ...]
    lights: tuple[CaptureLight, ...]


def light_views(views: Sequence[CaptureView], seed: int, hand_size: float) -> LitViews:
    """Give each view a light: a training view becomes one of each light group, a held-out view stays one.

    Args:
        views: of the capture; a `novel_light` view may show what a training view shows.
        seed: of the lights.
        hand_size: relative to the built-in hand's.
    """
    lit, lights = [], []
    training = 0
    kinds = {split: iter(_held_out_kinds(views, split, seed)) for split in get_args(Split) if split != "train"}
    for view in views:
        drawing = LightDrawing(_generator(view, seed), _towards(view), hand_size)
        if view.split == "train":
            groups = light_groups(drawing.training_light(training % _OCCLUDER_STEP == _FIRST_OCCLUDED))
            training += 1
        else:
            groups = (drawing.light(next(kinds[view.split])),)
        for index, light in enumerate(groups):
            lit.append(replace(view, file=_group_file(view.file, index), light=len(lights)))
            lights.append(light)
    return LitViews(tuple(lit), tuple(lights))


def of_first_poses(lit: LitViews, count: int) -> LitViews:
    """Select the views of the first poses, and their lights."""
    kept = [view for view in lit.views if view.pose_index < count]
    used = sorted({view.light for view in kept if view.light is not None})
    place = {light: index for index, light in enumerate(used)}
    views = tuple(replace(view, light=None if view.light is None else place[view.light]) for view in kept)
    return LitViews(views, tuple(lit.lights[index] for index in used))


def _held_out_kinds(views: Sequence[CaptureView], split: Split, seed: int) -> list:
    """Draw a kind of light for each view of a held-out split, in equal parts; the dome is not novel."""
    kinds = HELD_OUT_KINDS if split != "novel_light" else HELD_OUT_KINDS[:-1]
    count = sum(view.split == split for view in views)
    repeated = [kinds[index % len(kinds)] for index in range(count)]
    order = np.random.default_rng((seed, get_args(Split).index(split))).permutation(count)
    return [repeated[index] for index in order]


def _generator(view: CaptureView, seed: int) -> np.random.Generator:
    return np.random.default_rng((seed, view.pose_index, view.camera_index, get_args(Split).index(view.split)))


def _towards(view: CaptureView) -> np.ndarray:
    """Return [3] unit direction from the hand to the camera, which looks at it."""
    return -view.camera.cam2world[:3, 2]


def _group_file(file: str, group: int) -> str:
    return f"{file.removesuffix('.png')}_g{group}.exr"
