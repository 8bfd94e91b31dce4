"""Reads changed files until the time is up: a right result or a `LiveHandError`, nothing else.

Run as a program: its child limits its memory and each case's time, and refuses to start processes, to connect, and to
write outside its folder. A case that ends the child is a fault, and the next child goes on after it.
"""

import argparse
import contextlib
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter, defaultdict
from pathlib import Path

CASE_CPU_S, CASE_WALL_S, CASE_MIB = 10, 120, 2048
LEAST_CASES = 30  # of a process, however busy the machine is
_STARTS = (
    "subprocess.Popen",
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.fork",
    "os.spawn",
    "socket.connect",
    "pty.spawn",
)
_CHANGES = ("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.truncate", "os.link", "os.symlink", "os.chmod")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC


class Escape(BaseException):
    """A case started a process, connected, or wrote outside its folder."""


def guard(folder):
    """From now on, what only a broken reader does raises `Escape`."""
    root, sys.dont_write_bytecode = str(folder.resolve()), True

    def hook(event, arguments):
        if event.startswith(_STARTS):
            raise Escape(f"{event} {arguments!r:.200}")
        changes = event in _CHANGES or (event == "open" and isinstance(arguments[2], int) and arguments[2] & _WRITING)
        if changes and isinstance(arguments[0], str | bytes | os.PathLike):
            path = os.path.realpath(os.fsdecode(arguments[0]))
            if not path.startswith(root) and path != os.devnull:
                raise Escape(f"{event} {path}")

    sys.addaudithook(hook)


def run_case(seed, raw, folder):
    """What went wrong with one case; None if nothing did."""
    from livehand.backend.records.errors import LiveHandError

    case = folder / "case"
    shutil.rmtree(case, ignore_errors=True)
    case.mkdir()
    path = case / seed.name
    path.write_bytes(raw)
    signal.setitimer(signal.ITIMER_PROF, CASE_CPU_S)
    signal.alarm(CASE_WALL_S)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            seed.read(path)
    except LiveHandError as error:
        fault = None if str(error).strip() else "an empty message"
    except Escape as error:
        fault = f"escape: {error}"
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        ours = [frame for frame in traceback.extract_tb(error.__traceback__) if "backend" in frame.filename]
        where = ours[-1] if ours else place
        fault = f"{type(error).__name__}: {error!s:.120} at {Path(where.filename).name}:{where.lineno}"
    else:
        fault = None
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) >> 10
    return fault or (f"{grown} MiB of memory" if grown > CASE_MIB else None)


class Tally:
    """Cases and the first of each kind of fault, by reader."""

    def __init__(self):
        self.cases, self.faults = Counter(), defaultdict(dict)

    def add(self, reader, number, fault):
        self.cases[reader] += 1
        if fault:
            self.faults[reader].setdefault(fault, number)


def fuzz(folder, end, number):
    """Cases from this number until the time is up, at least LEAST_CASES; `folder/log` has a line around each."""
    os.environ["TQDM_DISABLE"] = "1"
    import numpy as np
    import numpy.testing  # asks for the processor by a process of its own, the first time that scipy imports it
    from seeds import all_seeds

    folder.mkdir()
    os.chdir(folder)
    seeds = all_seeds()
    wanted = number + LEAST_CASES
    guard(folder)
    for number_of_signal in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(number_of_signal, signal.SIG_DFL)  # ends the process, whatever it is in
    with (folder / "log").open("w") as log:
        while number < wanted or time.monotonic() < end:
            seed = seeds[number % len(seeds)]
            rng = np.random.default_rng(number)
            raw = seed.raw if number < len(seeds) else seed.mutated(rng)
            log.write(json.dumps([seed.reader, number]) + "\n")
            log.flush()
            log.write(json.dumps([seed.reader, number, run_case(seed, raw, folder)]) + "\n")
            number += 1


def run_children(folder, seconds, number):
    """The tally of as many children, one after another, as it takes."""
    tally, end, child = Tally(), time.monotonic() + seconds, 0
    while time.monotonic() < end:
        status, home, child = _forked(fuzz, folder / str(child), end, number), folder / str(child), child + 1
        lines = [json.loads(line) for line in (home / "log").read_text().splitlines()]
        for reader, case, fault in (line for line in lines if len(line) == 3):
            tally.add(reader, case, fault)
        shutil.rmtree(home)
        if not status:
            break
        if not os.WIFSIGNALED(status):
            sys.exit("the fuzzer itself failed")
        reader, case = lines[-1]
        tally.add(reader, case, signal.Signals(os.WTERMSIG(status)).name)
        number = case + 1
    return tally


def _forked(function, *arguments):
    """The status, as of `os.wait`, of a process that calls the function."""
    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1]
    try:
        function(*arguments)
        os._exit(0)
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(1)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30)
    parser.add_argument("--first", type=int, default=0, help="number of the first case; each number is one case")
    parser.add_argument("--memory-mib", type=int, default=16384, help="of the process, as address space")
    args = parser.parse_args()
    with contextlib.suppress(ValueError):
        resource.setrlimit(resource.RLIMIT_AS, (args.memory_mib << 20,) * 2)
    with tempfile.TemporaryDirectory(prefix="livehand-fuzz-") as folder:
        tally = run_children(Path(folder), args.seconds, args.first)
    for reader in sorted(tally.cases):
        sys.stdout.write(f"{reader:20s} {tally.cases[reader]:7d} cases  {len(tally.faults[reader])} kinds of faults\n")
        for fault, number in tally.faults[reader].items():
            sys.stdout.write(f"    case {number}: {fault}\n")
    faults = sum(map(len, tally.faults.values()))
    sys.stdout.write(json.dumps({"cases": tally.cases.total(), "faults": faults}) + "\n")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
