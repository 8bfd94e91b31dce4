"""Work shared among threads: every index once, whatever the numbers, no error is lost; and whose threads they are."""

from threading import Barrier, Event, Lock, Thread, current_thread, get_ident

import numpy as np
import pytest
import torch
from livehand.backend.compute.cpu.threads import in_parallel, kernel_threads, on_all_threads, threads_of_frame
from livehand.backend.system.thread_limits import thread_limit


@pytest.mark.parametrize("threads", [1, 2, 3, 8])
@pytest.mark.parametrize("count", [0, 1, 2, 7, 8, 15, 16, 17, 23, 24, 25, 63, 64, 65, 100, 1000, 1001])
def test_every_index_is_covered_once(count, threads):
    covered, lock = np.zeros(count + 1, np.int64), Lock()

    def run(first, last):
        assert 0 <= first <= last <= count
        with lock:
            covered[first:last] += 1

    in_parallel(run, count, threads)
    assert (covered[:count] == 1).all()
    assert covered[count] == 0


def test_many_indices_are_run_on_two_threads_and_few_on_this_one():
    seen, both = set(), Barrier(2)

    def run(first, last):
        if get_ident() not in seen:
            seen.add(get_ident())
            both.wait(10)

    in_parallel(run, 1000, 2)
    assert len(seen) == 2
    assert get_ident() in seen
    for count, threads in ((1000, 1), (5, 2)):
        here = []
        in_parallel(lambda first, last, here=here: here.append((get_ident(), first, last)), count, threads)
        assert here == [(get_ident(), 0, count)]


def test_nobody_waits_for_a_thread_that_does_not_come():
    """As where another program holds its core: here, another call has it."""
    started, over, here = Event(), Event(), []

    def hold(first, last):
        if current_thread().name.startswith("livehand"):
            started.set()
            over.wait(60)
        started.wait(60)

    other = Thread(target=in_parallel, args=(hold, 1000, 2))
    other.start()
    assert started.wait(60)
    work = Thread(target=in_parallel, args=(lambda first, last: here.append(get_ident()), 1000, 2))
    work.start()
    work.join(20)
    is_done = not work.is_alive()
    over.set()
    assert is_done
    assert set(here) == {work.ident}
    other.join()


@pytest.mark.parametrize("threads", [1, 2])
def test_an_error_in_one_part_comes_out(threads):
    def run(first, last):
        if first <= 500 < last:
            raise KeyError("from a part")

    with pytest.raises(KeyError, match="from a part"):
        in_parallel(run, 1000, threads)
    done = []
    in_parallel(lambda first, last: done.append(last - first), 1000, threads)  # and the threads work on
    assert sum(done) == 1000


def test_work_within_work_of_another_number_of_threads_comes_to_an_end():
    """Blender renders a frame beside the viewport's: calls overlap."""
    outer, sums = [], []

    def run(first, last):
        outer.append(last - first)
        in_parallel(lambda first, last: sums.append(last - first), 100, 3)

    in_parallel(run, 1000, 2)
    assert sum(outer) == 1000
    assert len(outer) > 2
    assert sum(sums) == 100 * len(outer)


def test_ranges_begin_large_and_end_small():
    ranges = []
    in_parallel(lambda first, last: ranges.append((first, last)), 1600, 2)
    sizes = [last - first for first, last in sorted(ranges)]
    assert sizes == sorted(sizes, reverse=True) or sizes[:-1] == sorted(sizes[:-1], reverse=True)
    assert sizes[0] == 400
    assert max(sizes[-3:]) <= 50
    assert len(sizes) < 16


@pytest.fixture
def three_threads():
    usual = torch.get_num_threads()
    torch.set_num_threads(3)
    yield
    torch.set_num_threads(usual)


def test_torch_has_one_thread_within_a_small_frame_and_kernels_all(three_threads):
    assert kernel_threads() == 3
    with threads_of_frame(1000):
        assert (torch.get_num_threads(), kernel_threads()) == (1, 3)
        with threads_of_frame(10**7):
            assert (torch.get_num_threads(), kernel_threads()) == (1, 3)
        assert on_all_threads(torch.get_num_threads)() == 3
        assert torch.get_num_threads() == 1
    assert (torch.get_num_threads(), kernel_threads()) == (3, 3)
    with threads_of_frame(10**7):
        assert (torch.get_num_threads(), kernel_threads()) == (3, 3)


def test_threads_are_as_before_after_an_error(three_threads):
    with pytest.raises(KeyError), threads_of_frame(1000):
        on_all_threads({}.__getitem__)("missing")
    assert (torch.get_num_threads(), kernel_threads()) == (3, 3)


def test_a_frame_of_one_thread_stays_on_one(three_threads):
    torch.set_num_threads(1)
    with threads_of_frame(1000):
        assert (torch.get_num_threads(), kernel_threads()) == (1, 1)


@pytest.mark.parametrize("limited", [lambda: threads_of_frame(100), lambda: thread_limit(1)])
def test_a_thread_that_is_born_while_another_renders_has_its_own_number(limited):
    usual, within, over, found = torch.get_num_threads(), Event(), Event(), []
    torch.set_num_threads(5)

    def render():
        with limited():
            within.set()
            over.wait(60)

    def ask():
        found.append((kernel_threads(), torch.get_num_threads()))
        over.wait(60)
        with threads_of_frame(100):
            found.append((kernel_threads(), torch.get_num_threads()))
        found.append((kernel_threads(), torch.get_num_threads()))

    try:
        renders, born = Thread(target=render), Thread(target=ask)
        renders.start()
        assert within.wait(60)
        born.start()
        while not found and born.is_alive():
            born.join(0.01)
        over.set()
        born.join(60)
        renders.join(60)
    finally:
        torch.set_num_threads(usual)
    assert found == [(5, 5), (5, 1), (5, 5)]
