"""Masks of photographed hands, from the posed mesh and GrabCut."""
