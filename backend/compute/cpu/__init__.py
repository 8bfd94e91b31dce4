"""The stages of a frame on the CPU in numba: the values of the reference, many times faster."""
