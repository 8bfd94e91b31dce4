"""The road from mesh to low-resolution maps on the CPU, by the kernels."""
