"""The part of `livehand benchmark` that needs Blender: Cycles on the same frames."""
