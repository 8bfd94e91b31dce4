"""An avatar as a mesh with textures, for other engines."""
