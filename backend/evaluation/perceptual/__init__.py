"""Perceptual distances: differences between the features of networks that others trained on photographs."""
