"""Extracts a triangle mesh from an avatar's density."""
