"""The kernels, by subject, as those of `compute.kernels`: the same names and arithmetic, a thread for each element."""
