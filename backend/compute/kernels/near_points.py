"""The nearest of some points to others, if it is near: points in an order that keeps neighbours together."""

import numpy as np

from .compiled import compiled

_TOGETHER = 8


@compiled
def find_near_points(points, seekers, sought, margin, reach, found):
    """Fill found [K] with which of the points [P, 3] that are sought is the nearest to each that seeks one.

    Args:
        points: [P, 3].
        seekers: [K] of them.
        sought: [L] of them, neighbours one after the other.
        margin: nothing is found for what lies farther outside the box of all that are sought.
        reach: nor if the nearest is as far away.
        found: [K] of the points; -1: none.
    """
    count = (len(sought) + _TOGETHER - 1) // _TOGETHER
    boxes = np.empty((count, 6))
    whole = np.array([np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf])
    for box in range(count):
        for axis in range(3):
            low, high = np.inf, -np.inf
            for k in range(box * _TOGETHER, min(len(sought), (box + 1) * _TOGETHER)):
                low, high = min(low, points[sought[k], axis]), max(high, points[sought[k], axis])
            boxes[box, axis], boxes[box, 3 + axis] = low, high
            whole[axis], whole[3 + axis] = min(whole[axis], low), max(whole[3 + axis], high)
    for k in range(len(seekers)):
        x, y, z = points[seekers[k], 0], points[seekers[k], 1], points[seekers[k], 2]
        found[k] = -1
        outside = max(whole[0] - x, x - whole[3], whole[1] - y, y - whole[4], whole[2] - z, z - whole[5])
        if not outside < margin:
            continue
        least = reach * reach
        for box in range(count):
            dx = max(boxes[box, 0] - x, 0.0, x - boxes[box, 3])
            dy = max(boxes[box, 1] - y, 0.0, y - boxes[box, 4])
            dz = max(boxes[box, 2] - z, 0.0, z - boxes[box, 5])
            if dx * dx + dy * dy + dz * dz >= least:
                continue
            for other in range(box * _TOGETHER, min(len(sought), (box + 1) * _TOGETHER)):
                at = sought[other]
                dx, dy, dz = points[at, 0] - x, points[at, 1] - y, points[at, 2] - z
                squared = dx * dx + dy * dy + dz * dz
                if squared < least:
                    least, found[k] = squared, at
