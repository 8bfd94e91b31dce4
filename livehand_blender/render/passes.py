"""The passes of a view layer, and how each is drawn from a picture.

In a scene, Cycles has rendered its own passes first; they are kept beside the hand, and ours are written over them.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping
from typing import NamedTuple

import bpy
import numpy as np

from ...backend.records.frame import DEPTH_BACKGROUND, Frame
from ...backend.render.cryptomatte import PAIRS_PER_LEVEL, crypto_ranks, merged_ranks
from ...backend.render.picture import Picture

ScenePasses = Mapping[str, np.ndarray]
"""Cycles' passes of a view layer by name, [H, W, C], top row first; empty if Cycles did not render."""


class Pass(NamedTuple):
    """One pass.

    Attributes:
        name: Blender's own name, if it has such a pass.
        channels: one letter each.
        kind: `COLOR`, `VECTOR` or `VALUE`.
        is_wanted: whether a view layer has it switched on.
        is_blenders: whether Blender adds it to the result, or the engine must.
        draw: makes [H, W] or [H, W, C] from the picture and Cycles' pass of the same name, if any.
    """

    name: str
    channels: str
    kind: str
    is_wanted: Callable[[bpy.types.ViewLayer], bool]
    is_blenders: bool
    draw: Callable[[Picture, np.ndarray | None], np.ndarray]


def _rgba(frame: Frame) -> np.ndarray:
    return np.concatenate([frame.rgb, frame.alpha[..., None]], -1)


def _surface(name: str, channels: int = 3) -> Callable[[Picture, np.ndarray | None], np.ndarray]:
    def draw(picture: Picture, scene: np.ndarray | None) -> np.ndarray:
        around = np.zeros((*picture.visible_alpha.shape, channels), np.float32) if scene is None else scene
        if picture.surface is None:
            return around
        # The rendered hand may reach a pixel beyond the mesh, where the maps are empty.
        is_mapped = picture.is_hand & (picture.surface["depth"] < DEPTH_BACKGROUND)
        return np.where(is_mapped[..., None], picture.surface[name], around)

    return draw


def _fade(picture: Picture) -> np.ndarray:
    """Return the fade, also where little of the hand is left."""
    return (
        np.zeros((*picture.visible_alpha.shape, 1), np.float32) if picture.surface is None else picture.surface["fade"]
    )


PASSES = (
    Pass("Combined", "RGBA", "COLOR", lambda layer: True, True, lambda picture, _: _rgba(picture.combined)),
    Pass("Depth", "Z", "VALUE", lambda layer: layer.use_pass_z, True, lambda picture, _: picture.combined.depth),
    Pass("Normal", "XYZ", "VECTOR", lambda layer: layer.use_pass_normal, True, _surface("normal")),
    Pass("UV", "UVA", "VECTOR", lambda layer: layer.use_pass_uv, True, _surface("uv")),
    Pass("Position", "XYZ", "VECTOR", lambda layer: layer.use_pass_position, True, _surface("position")),
    Pass("Vector", "XYZW", "VECTOR", lambda layer: layer.use_pass_vector, True, _surface("motion", 4)),
    Pass("Hand", "RGBA", "COLOR", lambda layer: layer.livehand.use_pass_hand, False, lambda p, _: _rgba(p.hands)),
    Pass("HandFade", "A", "VALUE", lambda layer: layer.livehand.use_pass_fade, False, lambda p, _: _fade(p)),
    Pass("HandAlpha", "A", "VALUE", lambda layer: layer.livehand.use_pass_hand, False, lambda p, _: p.visible_alpha),
)
SURFACE_PASSES = ("Normal", "UV", "Position", "Vector", "HandFade")
CRYPTOMATTE = "CryptoObject"
CRYPTOMATTE_LEVELS = tuple(f"{CRYPTOMATTE}{number:02d}" for number in range(8))  # Blender's limit: 16 ranks


def wanted_passes(layer: bpy.types.ViewLayer) -> tuple[Pass, ...]:
    """List the passes that a view layer has switched on."""
    return tuple(one for one in PASSES if one.is_wanted(layer))


def cryptomatte_passes(layer: bpy.types.ViewLayer) -> tuple[str, ...]:
    """Name the object Cryptomatte passes, of two ranks each, that a view layer has switched on."""
    count = (layer.pass_cryptomatte_depth + 1) // PAIRS_PER_LEVEL if layer.use_pass_cryptomatte_object else 0
    return CRYPTOMATTE_LEVELS[:count]


def drawn_passes(picture: Picture, names: Container[str], scene: ScenePasses) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and values of each pass: ours, and Cycles' others."""
    ours = {one.name: one.draw(picture, scene.get(one.name)) for one in PASSES if one.name in names}
    yield from {**scene, **ours, **_cryptomatte(picture, names, scene)}.items()


def _cryptomatte(picture: Picture, names: Container[str], scene: ScenePasses) -> Mapping[str, np.ndarray]:
    levels = [name for name in CRYPTOMATTE_LEVELS if name in names]
    if not levels or not picture.coverage:
        return {}
    if scene:
        ranks = merged_ranks(np.stack([scene[name] for name in levels]), picture.coverage)
    else:
        ranks = crypto_ranks(picture.coverage, len(levels))
    return dict(zip(levels, ranks, strict=True))
