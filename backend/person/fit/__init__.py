"""Poses and shape of pictures: where each picture wants the mesh's vertices, and the fit to it."""
