"""Multi-view captures: the on-disk format, its checks, and what a synthetic capture holds."""
