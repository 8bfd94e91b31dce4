"""Contact of a hand with things: signed distances of meshes, and *Grasp*, which closes a hand on them."""
