"""Footage that others took, turned into captures, and masks for what carries none."""
