"""Equals `surface.part_edges.blended`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled

_0, _1, _INF = (np.float32(value) for value in (0, 1, np.inf))
_RGB, _ITSELF = 3, 4


@compiled
def blend_parts(colours, alpha, depth, width, edges, least_alpha, first, last, out):
    """Fill out [S, 3] for slots [first, last) of `edges`: pixel [S], shows_first [9, S] and share [S].

    Colours [P, 3], alpha [P] and depth [P] are the image's.
    """
    pixel, shows_first, share = edges
    height = len(depth) // width
    total, count = np.empty((2, _RGB), np.float32), np.empty(2, np.float32)  # of the first part and of the other
    for slot in range(first, last):
        here = pixel[slot]
        y, x = here // width, here % width
        total[:], count[:] = _0, _0
        for row in range(3):
            for column in range(3):
                at = min(max(y + row - 1, 0), height - 1) * width + min(max(x + column - 1, 0), width - 1)
                if depth[at] < _INF and alpha[at] > least_alpha:
                    part = 0 if shows_first[3 * row + column, slot] else 1
                    count[part] += _1
                    for c in range(_RGB):
                        total[part, c] += colours[at, c] / alpha[at]
        has_both = count[0] > _0 and count[1] > _0
        if depth[here] < _INF and alpha[here] > least_alpha:  # of its own part it has its own colour alone
            own = 0 if shows_first[_ITSELF, slot] else 1
            count[own] = _1
            for c in range(_RGB):
                total[own, c] = colours[here, c] / alpha[here]
        for c in range(_RGB):
            out[slot, c] = colours[here, c]
            if has_both:
                of_first, of_other = total[0, c] / count[0], total[1, c] / count[1]
                out[slot, c] = (of_other + share[slot] * (of_first - of_other)) * min(alpha[here], _1)
