"""The shape keys by which the pads of a hand are flat, and how flat they are."""

from __future__ import annotations

import bpy
import numpy as np

PADS_PREFIX = "Grasp Pads"
"""Of the keys' names."""


def pads_keys(keys: bpy.types.Key) -> list[bpy.types.ShapeKey]:
    """List those of a mesh's shape keys that flatten pads."""
    return [key for key in keys.key_blocks if key.name.startswith(PADS_PREFIX)]


def clear_pads(mesh: bpy.types.Object) -> None:
    """Remove the shape keys of an earlier grasp, and their keyframes."""
    keys = mesh.data.shape_keys
    for key in pads_keys(keys):
        keys.driver_remove(f'key_blocks["{key.name}"].value')
        key.driver_remove("value")
        mesh.shape_key_remove(key)


def read_pressed_m(mesh: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> np.ndarray | None:
    """Measure how far [V] m the evaluated frame's pads are flattened, in the hand's own size; None: no key does it."""
    if mesh.data.shape_keys is None:
        return None
    keys = mesh.data.shape_keys.evaluated_get(depsgraph)
    flattening = [key for key in pads_keys(keys) if key.value != 0 and not key.mute]
    if not flattening:
        return None
    rest = _positions(keys.reference_key)
    offsets = sum(key.value * (_positions(key) - rest) for key in flattening)
    return np.linalg.norm(offsets, axis=1)


def _positions(key: bpy.types.ShapeKey) -> np.ndarray:
    positions = np.empty(3 * len(key.data), np.float32)
    key.data.foreach_get("co", positions)
    return positions.reshape(-1, 3)
