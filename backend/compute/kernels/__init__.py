"""Numba kernels for the CPU: arrays in, arrays out, many times faster than the torch code that they replace.

They are imported only if numba is installed and the device is the CPU. Each module names the torch function it equals.

Everything is float32, constants too: an int64 or float64 among them would make a whole expression float64. In inner
loops, tables are passed whole, with an index: slicing out a row costs a reference count, which is more than the
arithmetic.
"""
