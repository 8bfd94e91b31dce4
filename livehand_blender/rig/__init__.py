"""The posable hand: armature, skinned mesh, shape keys, drivers, and conversion between bones and theta."""
