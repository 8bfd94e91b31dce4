"""Compositor nodes: a hand over a rendered scene, and finished frames of a hand over a plate."""
