"""The built-in hand: where it comes from (an implicit surface after anatomical tables) and its detailed surface.

Everything in this folder is in millimetres, in one of two right-hand frames with the wrist joint at the origin:

- the *anatomical* frame, in which the surface is defined: d distal, h dorsal (height), r radial (towards the thumb);
- the *build* frame, in which meshes lie: x = -d, y = h, z = r, the axes of MANO.

The template, `hand_default.npz`, is the build frame shifted by (95, 0, 0) mm and told in metres (`frames.py`). The
shipped file is data; nothing here runs to load or pose it. Building it needs the extra `capture` (scipy, scikit-image).
"""
