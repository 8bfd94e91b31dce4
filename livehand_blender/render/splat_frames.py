"""The hands of a scene in frames and in its light, as splats are fitted to them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import bpy
import numpy as np

from ...backend.records.camera import Camera
from ...backend.records.errors import LiveHandError
from ...backend.render.session import Session
from ...backend.render.splats.lit_hand import LitHand
from ..motion.frames import current_frame_restored
from .frame_setup import read_lit_hands
from .hand_source import load_renderer_in_blender

_ANY_CAMERA = Camera(np.eye(3), np.eye(4), (64, 64))


def lit_frames(
    context: bpy.types.Context, frames: Iterable[int], is_chosen: Callable[[LitHand], bool]
) -> dict[int, tuple[LitHand, ...]]:
    """Read the chosen hands of the scene in frames, by number; their renderers are loaded.

    Raises:
        LiveHandError: there is no frame, a frame has no such hand, or a hand or an avatar is at fault.
    """
    session, scene, found = Session(load_renderer_in_blender), context.scene, {}
    with current_frame_restored(scene):
        for frame in frames:
            scene.frame_set(frame)
            hands = read_lit_hands(context.evaluated_depsgraph_get(), session, _ANY_CAMERA)
            found[frame] = tuple(hand for hand in hands if is_chosen(hand))
    if not found or not all(found.values()):
        missing = [frame for frame, hands in found.items() if not hands]
        raise LiveHandError(f"splats need a visible hand in every frame, got none in {missing[:5] or 'an empty range'}")
    return found
