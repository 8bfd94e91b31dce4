"""Hands of other rigs: our hand follows them or is baked from them, or a hand model is made from their mesh."""
