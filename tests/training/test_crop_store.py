"""Decoded windows: each once, ahead of need, from memory or from a file, and faults told to whoever asks."""

import gc
import threading
import time
import weakref
from collections import Counter

import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.training import crop_store as window_store
from livehand.backend.training.crop_store import CropStore

SIZES = [(4, 6), (3, 2), (10, 10), (1, 1), (7, 5)]


def window(index):
    width, height = SIZES[index]
    return np.random.default_rng(index).integers(0, 256, (height, width, 4)).astype(np.uint8)


class Decoder:
    """Counts, and holds every thread but the test's own until it is let go."""

    def __init__(self, is_free=True):
        self.calls, self.lock, self.gate, self.main = (
            Counter(),
            threading.Lock(),
            threading.Event(),
            threading.get_ident(),
        )
        if is_free:
            self.gate.set()

    def __call__(self, index):
        with self.lock:
            self.calls[index] += 1
        if threading.get_ident() != self.main:
            assert self.gate.wait(20)
        return window(index)


def eventually(holds):
    for _ in range(2000):
        if holds():
            return True
        time.sleep(0.005)
    return False


@pytest.mark.parametrize("budget", [10_000, 0])
def test_windows_are_what_was_decoded_in_memory_and_in_a_file(tmp_path, budget):
    store = CropStore(SIZES, Decoder(), tmp_path, budget)
    for index in (2, 0, 4, 1, 3, 2, 0):
        np.testing.assert_array_equal(store.get(index), window(index))
    assert list(tmp_path.iterdir()) == []  # the file has no name to be left behind
    assert isinstance(store._shelf._bytes, np.memmap) == (budget < 10_000)


def test_all_are_decoded_ahead_and_once(tmp_path):
    decoder = Decoder()
    store = CropStore(SIZES, decoder, tmp_path)
    assert not decoder.calls  # nothing before the first request
    store.get(4)
    assert eventually(lambda: len(decoder.calls) == 5)
    for index in range(5):
        store.get(index)
    assert set(decoder.calls.values()) == {1}


def test_what_is_not_there_yet_is_decoded_on_the_spot(tmp_path):
    """The threads are held at the first two windows; the others do not wait for them."""
    decoder = Decoder(is_free=False)
    store = CropStore(SIZES, decoder, tmp_path)
    np.testing.assert_array_equal(store.get(4), window(4))
    assert eventually(lambda: {0, 1} <= set(decoder.calls))
    np.testing.assert_array_equal(store.get(3), window(3))
    threading.Timer(0.2, decoder.gate.set).start()
    before = store.waited_s
    np.testing.assert_array_equal(store.get(0), window(0))  # waits for the thread that is at it
    assert store.waited_s - before > 0.05
    assert decoder.calls[0] == decoder.calls[3] == decoder.calls[4] == 1


def test_where_there_is_no_room_windows_are_decoded_again(tmp_path, monkeypatch):
    monkeypatch.setattr(window_store, "_DISK_SHARE", 0.0)
    decoder = Decoder()
    store = CropStore(SIZES, decoder, tmp_path, budget_bytes=4 * 24 + 4 * 6)  # the first two
    for _ in range(3):
        for index in range(5):
            np.testing.assert_array_equal(store.get(index), window(index))
    assert [decoder.calls[index] for index in range(5)] == [1, 1, 3, 3, 3]


def test_a_folder_that_cannot_be_written_to_is_done_without(tmp_path, monkeypatch):
    def refused(**where):
        raise PermissionError("read-only")

    monkeypatch.setattr(window_store.tempfile, "TemporaryFile", refused)
    store = CropStore(SIZES, Decoder(), tmp_path, budget_bytes=100)
    np.testing.assert_array_equal(store.get(2), window(2))


def test_faults_reach_whoever_asks_and_no_one_else(tmp_path):
    def decode(index):
        if index == 1:
            raise LiveHandError("image 1 is no picture")
        return window(index)

    store = CropStore(SIZES, decode, tmp_path)
    for _ in range(2):
        for index in (0, 2, 3, 4):
            np.testing.assert_array_equal(store.get(index), window(index))
        with pytest.raises(LiveHandError, match="image 1 is no picture"):
            store.get(1)


def test_a_dropped_store_ends_its_threads(tmp_path):
    decoder = Decoder(is_free=False)
    store = CropStore(SIZES, decoder, tmp_path)
    store.get(4)
    assert eventually(lambda: {0, 1} <= set(decoder.calls))
    gone = weakref.ref(store)
    del store
    gc.collect()
    assert gone() is None
    decoder.gate.set()
    time.sleep(0.05)
    assert set(decoder.calls) == {0, 1, 4}  # the windows in work are finished, no others begun
