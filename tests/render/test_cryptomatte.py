"""Cryptomatte: published hashes, and ranks computed by hand."""

import numpy as np
import pytest
from livehand.backend.render.cryptomatte import crypto_hash, crypto_id, crypto_ranks, merged_ranks, murmur3_32


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", 0),
        ("test", 0xBA6BD213),
        ("Hello, world!", 0xC0363E43),
        ("The quick brown fox jumps over the lazy dog", 0x2E4FF723),
    ],
)
def test_murmur_hashes_are_the_published_ones(text, expected):
    assert murmur3_32(text.encode()) == expected


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("hello", 6.0705627102400005616e-17),
        ("cube", -4.08461912519e15),
        ("sphere", 2.79018604383e15),
        ("plane", 3.66557617593e-11),
    ],
)
def test_ids_are_those_of_the_specifications_program(name, expected):
    assert float(crypto_id(name)) == pytest.approx(expected, rel=1e-11)


def test_every_id_is_a_normal_float(monkeypatch):
    module = "livehand.backend.render.cryptomatte.murmur3_32"
    for bits in (0x00000001, 0x7F800000, 0xFF800001, 0x807FFFFF):
        monkeypatch.setattr(module, lambda data, bits=bits: bits)
        assert np.isfinite(crypto_id("x"))
        assert abs(crypto_id("x")) >= np.finfo(np.float32).tiny
        assert crypto_hash("x") == bits ^ 1 << 23


def test_ranks_are_sorted_by_coverage():
    coverages = {"a": [[0.2, 0.0]], "b": [[0.5, 1.0]], "c": [[0.3, 0.0]]}
    a, b, c = (float(crypto_id(name)) for name in "abc")
    one, two = crypto_ranks({name: np.array(value) for name, value in coverages.items()}, level_count=2).tolist()
    np.testing.assert_array_equal(one, np.float32([[[b, 0.5, c, 0.3], [b, 1, 0, 0]]]))
    np.testing.assert_array_equal(two, np.float32([[[a, 0.2, 0, 0], [0, 0, 0, 0]]]))


def test_pairs_that_do_not_fit_are_left_out():
    coverages = {name: np.full((1, 1), coverage) for name, coverage in (("a", 0.2), ("b", 0.5), ("c", 0.3))}
    (level,) = crypto_ranks(coverages, level_count=1)
    np.testing.assert_array_equal(level[0, 0, 1::2], np.float32([0.5, 0.3]))


def test_merged_objects_cover_their_part_of_the_picture():
    before = {"wall": np.full((2, 3), 0.6), "cup": np.full((2, 3), 0.4)}
    hand = {"hand": np.linspace(0, 1, 6).reshape(2, 3)}
    left = 1 - hand["hand"]
    expected = crypto_ranks({**{name: part * left for name, part in before.items()}, **hand}, 2)
    merged = merged_ranks(crypto_ranks(before, 2), hand)
    np.testing.assert_allclose(merged[..., 1::2], expected[..., 1::2], atol=1e-6)
    is_clear = np.abs(np.diff(np.sort(np.stack([0.6 * left, 0.4 * left, hand["hand"]]), 0), axis=0)).min(0) > 1e-3
    np.testing.assert_array_equal(merged[:, is_clear][..., ::2], expected[:, is_clear][..., ::2])
