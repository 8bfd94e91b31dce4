"""Hands rigged by other people, in Blender: read, driven by, and made hand models of."""
