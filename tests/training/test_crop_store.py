"""Decoded crops: each decoded once, in advance, kept in memory or in a file; errors reach the caller."""

import gc
import tempfile
import threading
import time
import weakref
from collections import Counter

import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.training.crop_store import CropStore

SIZES = [(4, 6), (3, 2), (10, 10), (1, 1), (7, 5)]


def crop(index):
    width, height = SIZES[index]
    return np.random.default_rng(index).integers(0, 256, (height, width, 4)).astype(np.uint8)


class Decoder:
    """Counts its calls, and blocks every thread except the test's own until the gate is open."""

    def __init__(self, is_open=True):
        self.calls, self.lock, self.gate, self.main = (
            Counter(),
            threading.Lock(),
            threading.Event(),
            threading.get_ident(),
        )
        if is_open:
            self.gate.set()

    def __call__(self, index):
        with self.lock:
            self.calls[index] += 1
        if threading.get_ident() != self.main:
            assert self.gate.wait(20)
        return crop(index)


def eventually(holds):
    for _ in range(2000):
        if holds():
            return True
        time.sleep(0.005)
    return False


@pytest.mark.parametrize("budget", [10_000, 0])
def test_crops_are_kept_in_memory_or_in_a_file(tmp_path, budget):
    store = CropStore(SIZES, Decoder(), tmp_path, budget)
    for index in (2, 0, 4, 1, 3, 2, 0):
        np.testing.assert_array_equal(store.get(index), crop(index))
    assert list(tmp_path.iterdir()) == []  # the file has no name, so it is never left behind
    assert isinstance(store._buffer.data, np.memmap) == (budget < 10_000)


def test_all_are_decoded_in_advance_and_once(tmp_path):
    decoder = Decoder()
    store = CropStore(SIZES, decoder, tmp_path)
    assert not decoder.calls  # nothing is decoded before the first request
    store.get(4)
    assert eventually(lambda: len(decoder.calls) == 5)
    for index in range(5):
        store.get(index)
    assert set(decoder.calls.values()) == {1}


def test_a_crop_that_is_not_ready_is_decoded_by_the_caller(tmp_path):
    """The threads are blocked at the first two crops; the other crops do not wait for them."""
    decoder = Decoder(is_open=False)
    store = CropStore(SIZES, decoder, tmp_path)
    np.testing.assert_array_equal(store.get(4), crop(4))
    assert eventually(lambda: {0, 1} <= set(decoder.calls))
    np.testing.assert_array_equal(store.get(3), crop(3))
    threading.Timer(0.2, decoder.gate.set).start()
    before = store.waited_s
    np.testing.assert_array_equal(store.get(0), crop(0))  # waits for the thread that is decoding it
    assert store.waited_s - before > 0.05
    assert decoder.calls[0] == decoder.calls[3] == decoder.calls[4] == 1


def test_crops_without_room_are_decoded_again(tmp_path):
    decoder = Decoder()
    budget_bytes = 4 * 24 + 4 * 6  # the first two
    store = CropStore(SIZES, decoder, tmp_path, budget_bytes, disk_share=0.0)
    for _ in range(3):
        for index in range(5):
            np.testing.assert_array_equal(store.get(index), crop(index))
    assert [decoder.calls[index] for index in range(5)] == [1, 1, 3, 3, 3]


def test_a_read_only_folder_is_not_used(tmp_path, monkeypatch):
    def refused(**where):
        raise PermissionError("read-only")

    monkeypatch.setattr(tempfile, "TemporaryFile", refused)
    store = CropStore(SIZES, Decoder(), tmp_path, budget_bytes=100)
    np.testing.assert_array_equal(store.get(2), crop(2))


def test_errors_reach_only_the_caller_of_that_crop(tmp_path):
    def decode(index):
        if index == 1:
            raise LiveHandError("image 1 is no picture")
        return crop(index)

    store = CropStore(SIZES, decode, tmp_path)
    for _ in range(2):
        for index in (0, 2, 3, 4):
            np.testing.assert_array_equal(store.get(index), crop(index))
        with pytest.raises(LiveHandError, match="image 1 is no picture"):
            store.get(1)


def test_deleting_a_store_ends_its_threads(tmp_path):
    decoder = Decoder(is_open=False)
    store = CropStore(SIZES, decoder, tmp_path)
    store.get(4)
    assert eventually(lambda: {0, 1} <= set(decoder.calls))
    gone = weakref.ref(store)
    del store
    gc.collect()
    assert gone() is None
    decoder.gate.set()
    time.sleep(0.05)
    assert set(decoder.calls) == {0, 1, 4}  # crops being decoded are finished, no others begun
