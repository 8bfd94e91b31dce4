"""Hand models in MANO's format: files, skinning, atlas, bones, gestures and poses; and the built-in hand."""
