"""Transfer of poses, shape and atlas between another hand model in MANO's format and the built-in hand."""
