"""An avatar over filmed footage: the hand of a video re-enacted by another."""
