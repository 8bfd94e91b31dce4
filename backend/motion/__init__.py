"""Pose files: other people's hands in motion as ours, with mean, PCA, side and axes said aloud; and our own format."""
