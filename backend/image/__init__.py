"""Images of a hand: crop, low-resolution maps, super-resolution, shading, colour and depth."""
