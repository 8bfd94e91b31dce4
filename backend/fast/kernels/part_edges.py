"""Equals `nerf.part_edges.blended`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled

_0, _1, _INF = (np.float32(value) for value in (0, 1, np.inf))
_RGB = 3


@compiled
def blend_parts(colours, alpha, depth, width, edges, least_alpha, first, last, out):
    """Fill out [S, 3] for slots [first, last) of `edges`: pixel [S], shows_first [9, S] and share [S].

    Colours [P, 3], alpha [P] and depth [P] are the image's.
    """
    pixel, shows_first, share = edges
    height = len(depth) // width
    mean, own = np.empty((2, _RGB), np.float32), np.empty(_RGB, np.float32)
    for slot in range(first, last):
        here = pixel[slot]
        y, x = here // width, here % width
        mean[:] = _0
        count_first, count_other, side_of_own = _0, _0, -1
        for row in range(3):
            for column in range(3):
                at = min(max(y + row - 1, 0), height - 1) * width + min(max(x + column - 1, 0), width - 1)
                if not (depth[at] < _INF and alpha[at] > least_alpha):
                    continue
                side = 0 if shows_first[3 * row + column, slot] else 1
                if side == 0:
                    count_first += _1
                else:
                    count_other += _1
                if row == 1 and column == 1:
                    side_of_own = side
                for c in range(_RGB):
                    straight = colours[at, c] / max(alpha[at], least_alpha)
                    mean[side, c] += straight
                    if row == 1 and column == 1:
                        own[c] = straight
        for c in range(_RGB):
            out[slot, c] = colours[here, c]
        if count_first == _0 or count_other == _0:
            continue
        for c in range(_RGB):
            of_first = own[c] if side_of_own == 0 else mean[0, c] / count_first
            of_other = own[c] if side_of_own == 1 else mean[1, c] / count_other
            out[slot, c] = (of_other + share[slot] * (of_first - of_other)) * min(alpha[here], _1)
