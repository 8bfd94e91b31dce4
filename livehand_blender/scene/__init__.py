"""Reads a Blender scene into the backend's records, and turns its frames into Blender's colours."""
