"""The synthetic hand that captures show: an implicit surface from anatomical tables, and its detailed surface.

All modules use millimetres, in one of two right-hand frames with the wrist joint at the origin:

- the *anatomical* frame, which defines the surface: d distal, h dorsal (height), r radial (towards the thumb);
- the *build* frame, which meshes use: x = -d, y = h, z = r, the axes of MANO.

The hand's template is the build frame shifted by (95, 0, 0) mm, in metres (`frames.py`). Loading or
posing the shipped hand runs none of this. It needs the extra `capture` (scipy, scikit-image).
"""
