"""The light of a Blender scene as the backend's `Light`: lamps, world, and the objects nearby."""
