"""Flattened pads as shape keys of a hand's mesh: a few, whose values follow over a shot."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ..rig.keyframes import key_values

_PREFIX = "Grasp Pads"
_MOST_KEYS = 6
_LEFT_OUT_M = 0.00005  # of the offsets, that the keys may miss


def set_pads(mesh: bpy.types.Object, rest_offsets: np.ndarray, frames: Sequence[int] = ()) -> None:
    """Give a hand's mesh shape keys by which its pads flatten; those of an earlier grasp go.

    Args:
        mesh: of the hand.
        rest_offsets: [T, V, 3] m, of the unposed skin.
        frames: [T] of the scene, in which the keys' values are keyed; none: T is 1, and its key stays on.
    """
    clear_pads(mesh)
    flat = rest_offsets.reshape(len(rest_offsets), -1)
    if not np.abs(flat).max(initial=0.0) > _LEFT_OUT_M:
        return
    values, shapes = _components(flat)
    rest = np.empty(flat.shape[1], np.float32)
    mesh.data.shape_keys.reference_key.data.foreach_get("co", rest)
    for number, (value, shape) in enumerate(zip(values.T, shapes, strict=True)):
        key = mesh.shape_key_add(name=f"{_PREFIX} {number + 1}", from_mix=False)
        key.data.foreach_set("co", rest + shape.astype(np.float32))
        key.slider_min, key.slider_max, key.value = -1.0, 1.0, float(value[0])
        if len(frames):
            path = f'key_blocks["{key.name}"].value'
            key_values(mesh.data.shape_keys, path, _PREFIX, np.asarray(frames, float), value)


def clear_pads(mesh: bpy.types.Object) -> None:
    """Remove the shape keys of an earlier grasp, and their keyframes."""
    keys = mesh.data.shape_keys
    for key in [key for key in keys.key_blocks if key.name.startswith(_PREFIX)]:
        keys.driver_remove(f'key_blocks["{key.name}"].value')
        key.driver_remove("value")
        mesh.shape_key_remove(key)


def _components(flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Split offsets [T, n] into values [T, K], at most 1, and shapes [K, n]."""
    left, sizes, right = np.linalg.svd(flat, full_matrices=False)
    count = 1
    while count < min(_MOST_KEYS, len(sizes)):
        missed = flat - (left[:, :count] * sizes[:count]) @ right[:count]
        if np.abs(missed).max() <= _LEFT_OUT_M:
            break
        count += 1
    values, shapes = left[:, :count] * sizes[:count], right[:count]
    largest = np.abs(values).max(0)
    return values / largest, shapes * largest[:, None]
