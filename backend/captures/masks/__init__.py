"""Masks of photographed hands: the posed mesh and GrabCut."""
