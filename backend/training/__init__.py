"""Fitting an avatar to a capture."""
