"""Cycles multi-view captures of the built-in hand, the avatars' training data."""
