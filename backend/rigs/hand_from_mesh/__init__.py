"""A hand model in MANO's format from a skinned mesh made elsewhere."""
