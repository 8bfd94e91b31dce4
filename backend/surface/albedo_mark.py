"""An invisible mark of 64 bits in a surface's map of albedo, which outlives copies of the map, rounding and noise.

Each marked texel belongs to a bit and has a sign of its own, both random but always the same. The bit raises or lowers
it by a step, all channels alike. The reader takes the mean of its four neighbours off and adds up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

BITS = 64
MARK_BYTES = BITS // 8
SURE = 4.0
"""Score from which a map has a mark; maps without one have 0.8."""
_SEED = 0x5C1A11B0
_SPACING = 4  # every fourth texel along both axes is marked
_CLIP = 4.0  # steps: what stands out farther is drawn skin
_MOST = 127


class MarkReading(NamedTuple):
    """What was read of a map.

    Attributes:
        payload: 8 bytes; anything if the score is low.
        score: mean over the bits of how far each stands out of the map's own texture, in its standard deviations.
    """

    payload: bytes
    score: float

    @property
    def is_sure(self) -> bool:
        """Whether there is a mark at all."""
        return self.score >= SURE


def marked_steps(steps: np.ndarray, payload: bytes) -> np.ndarray:
    """Return a map [A, A, 3] int8 with a mark.

    Args:
        steps: of the map; those that are at a limit stay.
        payload: 8 bytes.

    Raises:
        ValueError: the payload has another length.
    """
    if len(payload) != MARK_BYTES:
        raise ValueError(f"a payload must have {MARK_BYTES} bytes, got {len(payload)}")
    bit, sign = _pattern(len(steps))
    signed = np.where(np.unpackbits(np.frombuffer(payload, np.uint8)), 1, -1)
    marked = steps.astype(np.int16)
    marked[::_SPACING, ::_SPACING] += (sign * signed[bit])[..., None].astype(np.int16)
    return marked.clip(-_MOST, _MOST).astype(np.int8)


def read_mark(steps: np.ndarray) -> MarkReading:
    """Read the mark of a map [A, A, 3], in steps, whole or not."""
    mean = steps.astype(np.float32).mean(-1)
    padded = np.pad(mean, 1, mode="edge")
    around = (padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]) / 4
    apart = (mean - around).clip(-_CLIP, _CLIP)[::_SPACING, ::_SPACING]
    bit, sign = _pattern(len(steps))
    sums = np.bincount(bit.ravel(), (sign * apart).ravel(), BITS)
    deviation = np.sqrt(np.bincount(bit.ravel(), (apart**2).ravel(), BITS)).clip(1e-6)
    return MarkReading(np.packbits(sums > 0).tobytes(), float(np.abs(sums / deviation).mean()))


def agreement(reading: MarkReading, payload: bytes) -> int:
    """Count the bits that agree with a payload."""
    different = np.frombuffer(reading.payload, np.uint8) ^ np.frombuffer(payload, np.uint8)
    return BITS - int(np.unpackbits(different).sum())


def _pattern(resolution: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw each marked texel's bit, 0 to 63, and its sign: [A / 4, A / 4] both."""
    side = -(-resolution // _SPACING)
    rng = np.random.Generator(np.random.PCG64(_SEED))
    return rng.integers(0, BITS, (side, side)), rng.integers(0, 2, (side, side)) * 2 - 1
