"""The files of animated rigs that Blender's importers read."""

RIG_SUFFIXES = (".bvh", ".fbx", ".glb", ".gltf", ".vrm")
