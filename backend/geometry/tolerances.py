"""Numbers that the kernels share with the torch modules that they replace."""

NEAR_M = 1e-3
"""Faces closer to the camera's plane than this are skipped: their projection is not a triangle."""

MIN_AREA_PX2 = 1e-9
"""Twice the area under which a projected face is edge-on and covers no pixel centre."""

MIN_DETERMINANT = 1e-24
"""Guards divisions by the determinant of degenerate (zero-area) triangles, m^4; far below any real face's."""

MAX_STEPS = 4
"""Walking steps per sample: consecutive samples are less than a face apart, except at grazing angles."""

LANES = 16
"""Neighbouring faces tried at once: one vector register of the widest processors."""

TRANSPARENT = 1 / 256
"""A ray on which less light is left (one 8-bit level) ends; if it is to end opaque, its samples then count for all."""

LEAST_SQUARED = 0.1
"""A light nearer than the mesh's own radius is given this squared sine; its map no longer holds all of the mesh."""

LEAST_WINDOW = 0.05
"""Half of a shadow map's width, radii of the mesh."""

STEEPEST = 8
"""Depth over width of a shadow map's pixel: a lit surface lies no more behind where light enters there."""
