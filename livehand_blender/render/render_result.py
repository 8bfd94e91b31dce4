"""Reads Cycles' passes from Blender's render result, and writes pictures into it."""

from __future__ import annotations

from collections.abc import Mapping

import bpy
import numpy as np

from ...backend.render.cryptomatte import crypto_metadata
from ...backend.render.picture import Picture
from .frame_setup import FrameSetup
from .light_groups import pass_name
from .passes import CRYPTOMATTE, ScenePasses, drawn_passes
from .picture_origin import metadata_fields


def read_scene(result: bpy.types.RenderResult, layer: str, view: str, size_px: tuple[int, int]) -> ScenePasses:
    """Read Cycles' passes of a view layer and stereo view, [H, W, C] by name, top row first."""
    passes = next(one for one in result.layers if one.name == layer).passes
    names = dict.fromkeys(one.name for one in passes)
    return {name: _read_pass(passes.find_by_name(name, view), size_px) for name in names}


def write_picture(
    engine: bpy.types.RenderEngine,
    frame: FrameSetup,
    view: str,
    picture: Picture,
    scene: ScenePasses,
    groups: Mapping[str, np.ndarray],
) -> None:
    """Write a view's picture, its scene's other passes, and those of its light groups.

    A result must be ended once begun, or Blender crashes when it saves.
    """
    for one in frame.passes:
        if not one.is_blenders:
            engine.add_pass(one.name, len(one.channels), one.channels, layer=frame.layer)
    if not frame.is_in_scene:
        for group in frame.light_groups:
            engine.add_pass(pass_name(group), 3, "RGB", layer=frame.layer)
    for name in frame.cryptomatte:
        engine.add_pass(name, 4, "RGBA", layer=frame.layer)
    result = engine.begin_result(0, 0, *frame.size_px, layer=frame.layer, view=view)
    try:
        passes = result.layers[0].passes
        for name, values in {**dict(drawn_passes(picture, passes.keys(), scene)), **groups}.items():
            _fill_pass(passes[name], values)
        for field, value in metadata_fields(frame.hands).items():
            engine.get_result().stamp_data_add_field(field, value)
        if frame.cryptomatte and not frame.is_in_scene:  # in a scene, Cycles has written the names of all objects
            for field, value in crypto_metadata(f"{frame.layer}.{CRYPTOMATTE}", picture.coverage).items():
                engine.get_result().stamp_data_add_field(field, value)
    finally:
        engine.end_result(result)


def _read_pass(render_pass: bpy.types.RenderPass, size_px: tuple[int, int]) -> np.ndarray:
    """Read a pass [H, W, C], top row first."""
    width, height = size_px
    flat = np.empty(width * height * render_pass.channels, np.float32)
    render_pass.rect.foreach_get(flat)
    return flat.reshape(height, width, render_pass.channels)[::-1]


def _fill_pass(render_pass: bpy.types.RenderPass, values: np.ndarray) -> None:
    """Write [H, W] or [H, W, C], top row first."""
    buffer = np.ascontiguousarray(values[::-1], np.float32).ravel()
    expected = len(render_pass.rect) * render_pass.channels
    if buffer.size != expected:
        raise RuntimeError(f"pass {render_pass.name} has {expected} numbers, the picture {buffer.size}")
    render_pass.rect.foreach_set(buffer)
