"""The renderer: torch and numpy, never bpy. Words, units and frames: docs/dev/conventions.md."""
