"""Measuring an avatar against a capture."""
