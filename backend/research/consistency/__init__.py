"""Whether a renderer's frames agree with each other: the same skin in neighbouring frames, found by the mesh."""
