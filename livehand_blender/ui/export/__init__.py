"""Operators that write files for other programs."""
