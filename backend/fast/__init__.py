"""The interfaces of `nerf` on the CPU in numba: the same values, many times faster."""
