"""Rotations, rasterisation and the canonical surface coordinates."""
