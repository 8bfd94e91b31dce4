"""The CPU's kernels, in numba: arrays in, arrays out, many times faster than the torch code they stand in for.

Imported only where numba is installed and the device is the CPU; everything works without them. Each says which torch
function it equals.

Everything is float32, constants too: an int64 or float64 among them makes a whole expression float64. In inner loops
tables are passed whole, with an index: a row taken out is counted as a reference, which costs more than the arithmetic.
"""
