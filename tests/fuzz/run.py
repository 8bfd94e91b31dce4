"""Reads changed files until the time is up: a right result or a `LiveHandError`, nothing else.

Run as a program, in a process of its own: it limits its memory and each case's processor time, and refuses to start
processes, to connect, and to write outside its folder. A case that kills it is found in that folder.
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

CASE_CPU_S, CASE_MIB = 10, 2048
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
    root = str(folder.resolve())

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
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) >> 10
    return fault or (f"{grown} MiB of memory" if grown > CASE_MIB else None)


def fuzz(folder, seconds, first):
    """Counts of cases and faults by reader."""
    import numpy as np
    import numpy.testing  # asks for the processor by a process of its own, the first time that scipy imports it
    from seeds import all_seeds

    seeds = all_seeds()
    guard(folder)
    signal.signal(signal.SIGPROF, signal.SIG_DFL)  # ends the process, whatever it is in
    counts, faults, end, number = Counter(), defaultdict(dict), time.monotonic() + seconds, first
    while time.monotonic() < end:
        seed = seeds[number % len(seeds)]
        rng = np.random.default_rng(number)
        raw = seed.raw if number < len(seeds) else seed.mutated(rng)
        (folder / "last").write_text(f"{seed.reader} {seed.name} case {number}")
        fault = run_case(seed, raw, folder)
        counts[seed.reader] += 1
        if fault and fault not in faults[seed.reader]:
            faults[seed.reader][fault] = number
        number += 1
    return counts, faults


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30)
    parser.add_argument("--first", type=int, default=0, help="number of the first case; each number is one case")
    parser.add_argument("--memory-mib", type=int, default=16384, help="of the process, as address space")
    args = parser.parse_args()
    with contextlib.suppress(ValueError):
        resource.setrlimit(resource.RLIMIT_AS, (args.memory_mib << 20,) * 2)
    folder = Path(tempfile.mkdtemp(prefix="livehand-fuzz-"))
    os.chdir(folder)
    counts, faults = fuzz(folder, args.seconds, args.first)
    for reader in sorted(counts):
        sys.stdout.write(f"{reader:20s} {counts[reader]:7d} cases  {len(faults[reader])} kinds of faults" + "\n")
        for fault, number in faults[reader].items():
            sys.stdout.write(f"    case {number}: {fault}" + "\n")
    sys.stdout.write(json.dumps({"cases": sum(counts.values()), "faults": sum(map(len, faults.values()))}) + "\n")
    shutil.rmtree(folder, ignore_errors=True)
    sys.exit(1 if any(faults.values()) else 0)


if __name__ == "__main__":
    main()
