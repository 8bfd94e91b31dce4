"""Hands that meet things of the scene: what they grasp, and the keys of pose and pads that follow."""
