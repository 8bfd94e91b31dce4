"""Reads cameras, hands and settings of a Blender scene into the backend's records."""
