"""Trained avatars: their files, metadata and thumbnails, those that ship, and those that are loaded."""
