"""Frames of a scene: its rate, and reading other frames than the current one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import bpy
import numpy as np


def frame_rate(scene: bpy.types.Scene) -> float:
    """Compute frames per second."""
    return scene.render.fps / scene.render.fps_base


@contextlib.contextmanager
def current_frame_restored(scene: bpy.types.Scene) -> Iterator[None]:
    """Restore the current frame afterwards; within, other frames can be set."""
    before = scene.frame_current_final
    try:
        yield
    finally:
        scene.frame_set(int(np.floor(before)), subframe=before % 1)
