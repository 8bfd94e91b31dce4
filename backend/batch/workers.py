"""`--jobs N`: the same command in N worker processes, which share the frames by leases.

A worker prints JSON events, which are merged here. Its standard input is a pipe that is never written to: when the pipe
ends, because this process was asked to stop or was killed, the worker stops as at Ctrl-C,
and after GRACE_S at the latest.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from queue import SimpleQueue

from ..records.errors import LiveHandError
from ..system.command import FAILED, INTERRUPTED, OK
from ..system.processes import ask_this_process_to_stop
from ..system.thread_limits import blas_settings
from .progress import Failed, FrameProgress, ShotOpened, from_record
from .report import RunReport

GRACE_S = 30.0
_THREAD_COUNTS = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")


def run_workers(argv: Sequence[str], jobs: int, began_ns: int, report: RunReport, may_refuse: bool = False) -> None:
    """Run this process's command in several worker processes, and wait for all of them.

    Args:
        argv: the program's arguments.
        jobs: the number of workers.
        began_ns: see `SequencePlan`.
        report: gets the workers' events.
        may_refuse: workers render nothing beside frames of another version.

    Raises:
        KeyboardInterrupt: Ctrl-C; the workers have stopped.
        LiveHandError: they opened two versions of a shot; they have stopped.
    """
    command = [*_this_program(argv), *argv, "--json", "--worker", str(began_ns)]
    workers = [
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=_environment(jobs))
        for _ in range(jobs)
    ]
    try:
        _merge(workers, report)
    except (KeyboardInterrupt, LiveHandError):
        _stop(workers)
        raise
    _report_missing_frames(workers, report, may_refuse)


def stop_with_parent() -> None:
    """Stop, in a worker, as at Ctrl-C when the standard input ends, and end if that takes longer than GRACE_S."""

    def wait() -> None:
        os.read(sys.stdin.fileno(), 1)  # a waiting buffered read would abort Python's exit
        ask_this_process_to_stop()
        time.sleep(GRACE_S)
        os._exit(INTERRUPTED)  # its leases end with it

    threading.Thread(target=wait, name="livehand parent", daemon=True).start()


def _this_program(argv: Sequence[str]) -> list[str]:
    """Return the command line before the arguments: Python and a script or module, or Blender and `--command`."""
    bpy = sys.modules.get("bpy")
    executable = (bpy and bpy.app.binary_path) or sys.executable
    if argv and sys.orig_argv[-len(argv) :] == list(argv):
        return [executable, *sys.orig_argv[1 : -len(argv)]]
    return [sys.executable, "-P", "-m", f"{str(__package__).removesuffix('.backend.batch')}.livehand_blender"]


def _environment(jobs: int) -> dict[str, str]:
    """Make the environment of a worker: workers share the cores, unless the user has set the numbers of threads."""
    threads = str(max(1, (os.cpu_count() or 1) // jobs))
    return dict.fromkeys(_THREAD_COUNTS, threads) | os.environ | blas_settings()


def _merge(workers: Sequence[subprocess.Popen[str]], report: RunReport) -> None:
    """Pass events on. A frame may be reported as skipped or left before its writer reports it, so those come last."""
    not_written: list[tuple] = []
    for record in _records(workers):
        shot, event = from_record(record)
        if isinstance(event, ShotOpened):
            report.add(shot, event)
            _check_version(shot, report)
        elif not isinstance(event, FrameProgress) or event.state == "written":
            report.add(shot, event)
        else:
            not_written.append((shot, event))
    for shot, event in sorted(not_written, key=lambda item: item[1].state != "skipped"):
        report.add(shot, event)


def _check_version(shot: Path, report: RunReport) -> None:
    if len(report.tallies[shot].versions) > 1:
        raise LiveHandError(
            f"{shot} and the files that it reads must stay as they are while workers open them, they opened "
            f"{len(report.tallies[shot].versions)} versions; run the same command again"
        )


def _records(workers: Sequence[subprocess.Popen[str]]) -> Iterator[dict]:
    """Yield the workers' events as they arrive, until all workers have ended."""
    lines: SimpleQueue[str | None] = SimpleQueue()

    def read(worker: subprocess.Popen[str]) -> None:
        assert worker.stdout is not None
        with worker.stdout as printed:
            for line in printed:
                lines.put(line)
        worker.wait()  # at once: until then the process counts as alive, and its leases are not superseded
        lines.put(None)

    for worker in workers:
        threading.Thread(target=read, args=(worker,), daemon=True).start()
    running = len(workers)
    while running:
        line = lines.get()
        running -= line is None
        if line and line.startswith('{"event"'):
            yield json.loads(line)


def _stop(workers: Sequence[subprocess.Popen[str]]) -> None:
    """Ask all workers to stop, and wait; kill them at a second Ctrl-C."""
    for worker in workers:
        if worker.stdin:
            worker.stdin.close()
    try:
        for worker in workers:
            worker.wait()
    except KeyboardInterrupt:
        for worker in workers:
            worker.kill()


def _report_missing_frames(workers: Sequence[subprocess.Popen[str]], report: RunReport, may_refuse: bool) -> None:
    """Make every incomplete shot fail, even if a worker was lost; frames left to a lost worker are missing."""
    codes = sorted({worker.returncode for worker in workers} - {OK})
    is_lost = any(code != FAILED for code in codes)
    ends = ", ".join(f"signal {-code}" if code < 0 else f"exit code {code}" for code in codes)
    for shot, tally in report.tallies.items():
        missing = tally.missing(with_left=is_lost)
        has_refused = may_refuse and tally.others
        if missing and not tally.errors and not has_refused:
            report.add(shot, Failed(f"{missing} missing: a worker process failed ({ends}); run the same command again"))
