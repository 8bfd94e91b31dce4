"""The neural hand over Blender's preview of the scene, in 3D views with Rendered shading."""
