"""A filmed take onto a hand: its keys, and markers where the hand was lost or its fit error is large."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ...backend.motion.landmarks.take_fit import TakeFit
from ..rig.hand import RiggedHand
from .frames import frame_rate
from .keying import Placement, key_motion

_PREFIX = "LiveHand: "
_MARKED_FIT_ERROR = 0.045  # of the hand's size; good frames have half of it
_MOST_MARKERS = 40


def key_take(scene: bpy.types.Scene, hand: RiggedHand, fit: TakeFit, placement: Placement) -> int:
    """Key a hand with a fitted take, which begins at the placement's frame; returns the number of keyed frames.

    Raises:
        LiveHandError: as `key_motion`. Nothing is changed then.
    """
    rate = frame_rate(scene) if placement.matches_fps else fit.motion.fps or frame_rate(scene)
    start = placement.start_frame + round(fit.start_s * rate)
    count = key_motion(scene, hand, fit.motion, replace(placement, start_frame=start), fit.is_keyed)
    _mark(scene, hand.armature.name, fit, start, rate / (fit.motion.fps or rate))
    return count


def _mark(scene: bpy.types.Scene, name: str, fit: TakeFit, start: int, frames_per_step: float) -> None:
    """Mark where gaps and doubtful stretches begin; markers of an earlier import are replaced."""
    markers = scene.timeline_markers
    last = start + round((len(fit.fit_error) - 1) * frames_per_step)
    for marker in [one for one in markers if one.name.startswith(_PREFIX) and one.name.endswith(name)]:
        if start <= marker.frame <= last:
            markers.remove(marker)
    lost, doubtful = ~fit.is_keyed, fit.is_keyed & (fit.fit_error > _MARKED_FIT_ERROR)
    found = [(step, "no hand") for step in _starts(lost)] + [(step, "check") for step in _starts(doubtful)]
    worst = sorted(found, key=lambda one: -fit.fit_error[one[0]])[:_MOST_MARKERS]
    for step, word in worst:
        markers.new(f"{_PREFIX}{word}, {name}", frame=start + round(step * frames_per_step))


def _starts(is_in: np.ndarray) -> list[int]:
    """Find the first index of every run."""
    return np.flatnonzero(is_in & ~np.r_[False, is_in[:-1]]).tolist()
