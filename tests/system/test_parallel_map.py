"""Items are worked on at once and come back in order; torch has one thread in each, errors end it."""

import threading
import time

import pytest
import torch
from livehand.backend.system.parallel_map import parallel_map


def test_results_have_the_items_order_whoever_is_first():
    def slow_first(item):
        time.sleep(0.05 if item == 0 else 0)
        return item * item

    assert parallel_map(slow_first, range(5), threads=3) == [0, 1, 4, 9, 16]


def test_items_are_worked_on_at_once():
    """Both wait for each other: one after the other would break the barrier."""
    together = threading.Barrier(2, timeout=20)
    assert sorted(parallel_map(lambda item: together.wait(), [0, 0], threads=2)) == [0, 1]


def test_torch_has_one_thread_in_each_and_as_many_as_before_after():
    before = torch.get_num_threads()
    assert parallel_map(lambda item: torch.get_num_threads(), [0, 1, 2], threads=2) == [1, 1, 1]
    assert torch.get_num_threads() == before


def test_the_first_error_is_raised_and_what_has_not_begun_is_left_out():
    begun = []

    def work(item):
        begun.append(item)
        if item == 1:
            raise ValueError("of item 1")
        return item

    with pytest.raises(ValueError, match="of item 1"):
        parallel_map(work, range(1000), threads=1)
    assert len(begun) < 1000


def test_done_is_told_after_each_in_the_calling_thread():
    told = []
    parallel_map(lambda item: item, range(4), lambda: told.append(threading.get_ident()), threads=2)
    assert told == [threading.get_ident()] * 4
