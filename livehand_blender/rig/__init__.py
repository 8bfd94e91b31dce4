"""The posable hand: armature, skinned mesh, shape keys, drivers, and the map between bones and theta."""
