"""Kernels that are compiled before a picture needs them."""
