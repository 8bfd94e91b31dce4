"""Reads cameras, colours, nodes and settings of a Blender scene."""
