"""Motions as keyframes of a hand."""
