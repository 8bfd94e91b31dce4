"""The threads of a frame: kernels share all of them, and where torch only has small things to do, it takes one.

Kernels release the GIL and run on plain Python threads: numba's own threading layers must not be entered from two
threads at once, which Blender does (a render beside the viewport).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from functools import cache
from typing import Any, ParamSpec, TypeVar

import torch

from ...system.thread_limits import own_threads, thread_limit

# Ranges are halves of what is left for each thread, down to this part of its share: few to start with, since each costs
# up to 40 us, and short ones at the end, so that nobody waits long for a thread with costly pixels.
_PARTS_OF_SHARE = 16
_FEWEST = 8
_SMALL_PX = 1 << 18
_kernel_threads: ContextVar[int] = ContextVar("threads of the kernels, if torch has others")

Inputs = ParamSpec("Inputs")
Result = TypeVar("Result")


def in_parallel(run: Callable[[int, int], Any], count: int, threads: int | None = None) -> None:
    """Call run(first, last) for consecutive ranges of [0, count) on `threads` threads; None: as many as kernels have.

    The calling thread is one of them, and whoever is ready takes the next range: if other programs hold a core, nobody
    waits for the thread that would run there.
    """
    threads = kernel_threads() if threads is None else threads
    if threads == 1 or count < threads * _FEWEST:
        run(0, count)
        return
    ranges = iter(_ranges(count, threads))

    def work() -> None:
        for first, last in ranges:
            run(first, last)

    helpers = [_pool(threads - 1).submit(work) for _ in range(threads - 1)]
    try:
        work()
    finally:
        failed = [helper.exception() for helper in helpers if not helper.cancel()]
    for error in filter(None, failed):
        raise error


def kernel_threads() -> int:
    """Return on how many threads kernels run."""
    return _kernel_threads.get(0) or own_threads()


@contextlib.contextmanager
def threads_of_frame(pixels: int) -> Iterator[None]:
    """Enter the context of a frame of this many pixels. If small, torch has one thread within, and kernels as before.

    torch's threads sleep between operations, and waking them takes longer than many of these.
    """
    threads = own_threads()
    token = _kernel_threads.set(kernel_threads())  # once for all kernels
    try:
        with contextlib.nullcontext() if pixels > _SMALL_PX or threads == 1 else thread_limit(1):
            yield
    finally:
        _kernel_threads.reset(token)


def on_all_threads(network: Callable[Inputs, Result]) -> Callable[Inputs, Result]:
    """Wrap what computes with large tensors in torch, so that it always runs on as many threads as kernels."""

    def run(*args: Inputs.args, **kwargs: Inputs.kwargs) -> Result:
        few, all_of_them = torch.get_num_threads(), kernel_threads()
        torch.set_num_threads(all_of_them)
        try:
            return network(*args, **kwargs)
        finally:
            torch.set_num_threads(few)

    return run


def _ranges(count: int, threads: int) -> list[tuple[int, int]]:
    ranges, first, least = list[tuple[int, int]](), 0, -(-count // (threads * _PARTS_OF_SHARE))
    while first < count:
        last = min(first + max(-(-(count - first) // (2 * threads)), least), count)
        ranges.append((first, last))
        first = last
    return ranges


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="livehand-kernels")
