"""Blender has kernels compiled in processes of their own, which are this job.

Several processes share those of the first pictures: each computes some subjects by kernels, and the others as the
reference does.
"""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Mapping
from typing import Any

from ...avatars.library import shipped_avatar_path
from ...system.child_job import JobProgress, Report, run_job
from ...system.processes import give_way
from ...system.thread_limits import usable_threads
from .kernels import prepare_kernels, prepare_share

LAST_REQUEST = None
"""All kernels of every precision: what the first processes have compiled, this one loads."""
READY = "the first picture can be rendered"
"""What a process says as its progress when its share of these kernels is there; it then compiles the next ones."""
_MOST_PROCESSES = 4
_LOOK_S = 0.5


def first_requests() -> list[list[int]]:
    """Return which of how many each process is that compile together what first pictures need."""
    count = max(1, min(_MOST_PROCESSES, usable_threads()))
    return [[number, count] for number in range(count)]


def run() -> None:
    """Compile kernels in the process of a job."""
    run_job(_prepared, "the kernels need more memory than is free; close other programs")


def _prepared(request: list[int] | None, report: Report) -> Mapping[str, Any]:
    began = time.perf_counter()
    gc.disable()  # compilers make many objects that live long: looking for dead ones takes a tenth of the time
    if request is None:
        give_way()  # first pictures are rendered beside it
        prepare_kernels(shipped_avatar_path())
    else:
        is_ready = threading.Event()
        counting = threading.Thread(target=_count, args=(report, is_ready), name="livehand count", daemon=True)
        counting.start()
        number, count = request
        prepare_share(shipped_avatar_path(), number, count, is_ready.set)
        counting.join()
    return {"seconds": time.perf_counter() - began}


def _count(report: Report, is_ready: threading.Event) -> None:
    """Report which share of the kernels is compiled, until the process is ready."""
    from ...compute.cpu import backend  # noqa: F401, which imports all kernels
    from ...compute.kernels.compiled import kernel_counts

    while True:
        ends = is_ready.wait(_LOOK_S)
        compiled, every = kernel_counts()
        report(JobProgress(READY if ends else f"{compiled} of {every}", compiled / max(every, 1)))
        if ends:
            return
