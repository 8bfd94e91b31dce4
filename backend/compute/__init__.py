"""The stages of a frame on a device: the reference in torch, and numba on the CPU."""
