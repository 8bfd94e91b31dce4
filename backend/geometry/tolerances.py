"""Numbers that the kernels and the torch modules they stand for must share."""

NEAR_M = 1e-3
"""Faces that reach closer to the camera's plane than this are left out: their projection is not a triangle."""

MIN_AREA_PX2 = 1e-9
"""Twice the area under which a projected face is edge-on and covers no pixel centre."""

MIN_DETERMINANT = 1e-24
"""Guards quotients over degenerate (zero-area) triangles, m^2 squared; far below any real face's."""

MAX_STEPS = 4
"""Walking steps per sample: neighbouring samples lie less than a face apart, but for long steps at grazing angles."""

LANES = 16
"""Faces around a face are tried so many at once: one register of the widest processors."""
