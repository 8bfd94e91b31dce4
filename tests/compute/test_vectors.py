"""Sums of windows: the same numbers whether a block takes its registers at once or one vector after the other."""

import numpy as np
import pytest
from livehand.backend.compute.kernels import vectors
from livehand.backend.compute.kernels.vectors import LANES, has_vectors, window_sums
from numba import njit

PIXELS, VECTORS, CHANNELS = 6, 4, 5


def sums_of(source, weights):
    @njit
    def summed(source, weights, sums):
        pixel_bytes = source.itemsize * source.shape[2]
        row_bytes = pixel_bytes * source.shape[1]
        window_sums(3, 6, 4, source, row_bytes + pixel_bytes, pixel_bytes, row_bytes, weights, sums)

    sums = np.full((PIXELS, VECTORS * LANES), np.nan, np.float32)
    summed(source, weights, sums)
    return sums


@pytest.mark.slow
@pytest.mark.skipif(not has_vectors(), reason="needs a processor with AVX2 or AVX-512")
@pytest.mark.parametrize("is_wide", [False, True])
def test_a_block_in_passes_is_the_sum_of_its_products(is_wide, monkeypatch):
    monkeypatch.setattr(vectors, "_has_wide_registers", lambda: is_wide)
    random = np.random.default_rng(0)
    source = random.integers(-9, 9, (5, 12, CHANNELS)).astype(np.float32)
    weights = random.integers(-9, 9, (9, CHANNELS, VECTORS * LANES)).astype(np.float32)
    windows = np.stack([source[1:4, 1 + pixel : 4 + pixel].reshape(9, CHANNELS) for pixel in range(PIXELS)])
    np.testing.assert_array_equal(sums_of(source, weights), np.einsum("ptc,tco->po", windows, weights))
    source, weights = (random.normal(size=one.shape).astype(np.float32) for one in (source, weights))
    ours = sums_of(source, weights)
    monkeypatch.setattr(vectors, "_has_wide_registers", lambda: not is_wide)
    np.testing.assert_array_equal(sums_of(source, weights), ours)


@pytest.mark.parametrize(
    ("features", "is_found"),
    [({"avx512f"}, True), ({"avx2", "fma"}, True), ({"avx2"}, False), ({"sse4.2"}, False)],
)
def test_processors_with_vectors(monkeypatch, features, is_found):
    for known in (vectors.has_vectors, vectors._has_wide_registers):
        known.cache_clear()
    monkeypatch.setattr(vectors, "_has", lambda feature: feature in features)
    try:
        assert vectors.has_vectors() == is_found
    finally:
        for known in (vectors.has_vectors, vectors._has_wide_registers):
            known.cache_clear()
