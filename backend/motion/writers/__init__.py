"""Motions of hands -> files of other programs; the readers of the same files are in `formats` and `landmarks`."""
