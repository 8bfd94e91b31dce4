"""The same for each of many items, such as pictures, at once: one thread an item, and torch has one in each.

A picture's operations are small: two threads that have a picture each are faster than two that share one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from .thread_limits import thread_limit, usable_threads

Item = TypeVar("Item")
Result = TypeVar("Result")


def parallel_map(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    on_done: Callable[[], None] = lambda: None,
    threads: int | None = None,
) -> list[Result]:
    """Return work(item) of all items, in their order; the first error is raised, and what has not begun is left out.

    Args:
        work: must release the GIL to gain by it, and may keep nothing that threads would share.
        items: to be worked on.
        on_done: called after each, in the calling thread.
        threads: at most; None: as many as torch may use.
    """

    def alone(item: Item) -> Result:
        with thread_limit(1):
            return work(item)

    results: list[Result] = []
    with ThreadPoolExecutor(max(1, threads or usable_threads()), thread_name_prefix="livehand-each") as pool:
        futures = [pool.submit(alone, item) for item in items]
        try:
            for future in futures:
                results.append(future.result())
                on_done()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
    return results
