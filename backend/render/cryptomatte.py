"""Cryptomatte: how much of each pixel every object covers, in the format of the open specification.

An object's id is the hash of its name, stored as the bits of a float. The (id, coverage) pairs of a pixel are sorted by
coverage and stored two to a level: R and G hold one pair, B and A the next. Metadata maps names to ids.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping

import numpy as np

_MASK = 0xFFFFFFFF
PAIRS_PER_LEVEL = 2


def murmur3_32(data: bytes) -> int:
    """Compute MurmurHash3, x86, 32 bits, seed 0."""
    state = 0
    whole = len(data) - len(data) % 4
    for (block,) in struct.iter_unpack("<I", data[:whole]):
        state = (_rotated(state ^ _scrambled(block), 13) * 5 + 0xE6546B64) & _MASK
    state ^= _scrambled(int.from_bytes(data[whole:], "little"))
    state ^= len(data)
    state = (state ^ state >> 16) * 0x85EBCA6B & _MASK
    state = (state ^ state >> 13) * 0xC2B2AE35 & _MASK
    return state ^ state >> 16


def crypto_hash(name: str) -> int:
    """Hash a name, changed where needed so that the bits are a normal float: not denormal, infinite or NaN."""
    bits = murmur3_32(name.encode())
    exponent = bits >> 23 & 0xFF
    return bits ^ 1 << 23 if exponent in (0, 0xFF) else bits


def crypto_id(name: str) -> np.float32:
    """Return the float that represents a name in the image."""
    return np.uint32(crypto_hash(name)).view(np.float32)


def crypto_ranks(coverages: Mapping[str, np.ndarray], level_count: int) -> np.ndarray:
    """Compute the levels of the image, sorted by coverage from the largest down; pairs that do not fit are left out.

    Args:
        coverages: object name -> [H, W] in [0, 1]; at least one object.
        level_count: number of levels, each of two pairs.

    Returns:
        [level_count, H, W, 4] float32 (id, coverage, id, coverage); zeros where no pair is left.
    """
    return _ranked(_pairs_of(coverages), level_count)


def merged_ranks(levels: np.ndarray, coverages: Mapping[str, np.ndarray]) -> np.ndarray:
    """Update the levels of a picture with objects put over it, which cover a part of what each pixel showed before.

    Args:
        levels: [L, H, W, 4] of the picture without these objects.
        coverages: object name -> [H, W] in [0, 1], at most 1 in sum; at least one object.

    Returns:
        [L, H, W, 4].
    """
    before = np.concatenate([levels[..., :2], levels[..., 2:]])
    left = 1 - sum(coverages.values(), np.zeros(levels.shape[1:3], np.float32))
    before = before * np.stack([np.ones_like(left), left], -1)
    return _ranked(np.concatenate([before, _pairs_of(coverages)]), len(levels))


def crypto_metadata(layer: str, names: Iterable[str]) -> dict[str, str]:
    """Return the metadata fields that a file must have.

    Args:
        layer: the name of the passes without their number, such as `ViewLayer.CryptoObject`.
        names: of all objects.
    """
    prefix = f"cryptomatte/{crypto_hash(layer):08x}"[:-1]
    manifest = {name: f"{crypto_hash(name):08x}" for name in names}
    return {
        f"{prefix}/name": layer,
        f"{prefix}/hash": "MurmurHash3_32",
        f"{prefix}/conversion": "uint32_to_float32",
        f"{prefix}/manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":")),
    }


def _pairs_of(coverages: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return (id, coverage) [N, H, W, 2] of each object."""
    parts = ((crypto_id(name), np.asarray(coverage, np.float32)) for name, coverage in coverages.items())
    return np.stack([np.stack([np.full_like(part, number), part], -1) for number, part in parts])


def _ranked(pairs: np.ndarray, level_count: int) -> np.ndarray:
    """Sort pairs [N, H, W, 2] by coverage, two to a level: [level_count, H, W, 4]."""
    order = np.argsort(-pairs[..., 1], axis=0, kind="stable")[: PAIRS_PER_LEVEL * level_count]
    ranked = np.take_along_axis(pairs, order[..., None], axis=0)
    kept = np.zeros((PAIRS_PER_LEVEL * level_count, *pairs.shape[1:]), np.float32)
    kept[: len(ranked)] = np.where(ranked[..., 1:] > 0, ranked, 0)
    levels = kept.reshape(level_count, PAIRS_PER_LEVEL, *kept.shape[1:])
    return np.concatenate(list(levels.swapaxes(0, 1)), axis=-1)


def _scrambled(block: int) -> int:
    return _rotated(block * 0xCC9E2D51 & _MASK, 15) * 0x1B873593 & _MASK


def _rotated(bits: int, count: int) -> int:
    return (bits << count | bits >> 32 - count) & _MASK
