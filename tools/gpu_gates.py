"""Measure what is asked of a GPU: each gate in a process of its own, what was measured, and whether it holds.

python -m livehand.tools.gpu_gates [--frames N] [--only GATE] [--minutes M] [--json FILE] [--rehearse]

Lines and the file grow gate by gate: one that fails, hangs or ends its process takes no other with it.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from ..backend.records.errors import LiveHandError
from .gpu_gate_jobs import (
    GpuGate,
    Machine,
    gate_of_batch,
    gate_of_first_frame,
    gate_of_kernels,
    gate_of_size,
    gate_of_training,
    gates_beside_paper,
)

_TESTS = "tests/test_cuda.py", "tests/compute/gpu"
_REHEARSED_TESTS = ("tests/compute/gpu/test_backend.py",)
_MOST_TEST_S = 100.0
_REHEARSED_FRAMES, _REHEARSED_SLACK = 1, 4
_ENDED = 5.0  # s, that are left for the last lines

Job = Callable[[Machine, int], list[GpuGate]]


def gate_of_tests(machine: Machine, tests: Sequence[str] = _TESTS) -> GpuGate:
    """Run the tests that need a GPU, without those that Warp's CPU device runs everywhere."""
    if machine.is_rehearsal:
        tests = _REHEARSED_TESTS
    start, root = time.perf_counter(), Path(__file__).parents[1]
    command = [sys.executable, "-m", "pytest", "-q", "-k", "not [cpu", *tests]
    done = subprocess.run(command, cwd=root, check=False, stdout=sys.stderr)
    took = time.perf_counter() - start
    passed = "passed" if done.returncode == 0 else "FAILED"
    holds = done.returncode == 0 and took <= _MOST_TEST_S
    return GpuGate("tests on the GPU", f"pass within {_MOST_TEST_S:.0f} s", f"{passed}, {took:.0f} s", holds)


JOBS: dict[str, tuple[Job, float]] = {
    "kernels": (lambda machine, _: [gate_of_kernels(machine)], 150),
    "first": (lambda machine, _: [gate_of_first_frame(machine)], 60),
    "small": (gates_beside_paper, 90),
    "1080p": (lambda machine, frames: [gate_of_size(machine, 1, frames)], 60),
    "4k": (lambda machine, frames: [gate_of_size(machine, 2, frames)], 60),
    "batch": (lambda machine, frames: [gate_of_batch(machine, frames)], 60),
    "training": (lambda machine, _: [gate_of_training(machine)], 100),
    "tests": (lambda machine, _: [gate_of_tests(machine)], 200),
}
"""What measures, and the most seconds that it is waited for."""


def measured(name: str, machine: Machine, frames: int, most_s: float) -> list[GpuGate]:
    """Run a job in a process of its own; one that does not end well is a gate that does not hold."""
    command = [sys.executable, "-m", "livehand.tools.gpu_gates", "--job", name, "--frames", str(frames)]
    if machine.is_rehearsal:
        command.append("--rehearse")
    found: list[GpuGate] = []
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False, timeout=most_s)
        lines, ended = done.stdout.splitlines(), f"ended with exit code {done.returncode}"
    except subprocess.TimeoutExpired as error:
        lines = (error.stdout or b"").decode().splitlines()  # bytes, whatever was asked for
        done, ended = None, f"not done after {most_s:.0f} s"
    for line in lines:
        with suppress(json.JSONDecodeError, TypeError):
            found.append(GpuGate(**json.loads(line)))
    if done is None or done.returncode:
        found.append(GpuGate(name, "ends", ended, False))
    return found


def all_measured(machine: Machine, names: Sequence[str], frames: int, minutes: float) -> Iterator[GpuGate]:
    """Run jobs one after the other, as long as there is time; a rehearsal has more, on a CPU that others may share."""
    slack = _REHEARSED_SLACK if machine.is_rehearsal else 1
    end = time.monotonic() + 60 * minutes * slack
    for name in names:
        left = end - time.monotonic() - _ENDED
        if left <= 0:
            yield GpuGate(name, "ends", f"not begun, as {minutes:g} minutes are over", False)
            continue
        yield from measured(name, machine, frames, min(slack * JOBS[name][1], left))


def main(argv: Sequence[str] | None = None) -> int:
    """Measure all; returns 1 if a gate does not hold; after a rehearsal, if a job did not end well."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=50, help="of each size (default: %(default)s)")
    parser.add_argument("--only", nargs="+", choices=JOBS, default=list(JOBS), help="these, in order")
    parser.add_argument("--minutes", type=float, default=8.5, help="for all (default: %(default)s)")
    parser.add_argument("--json", type=Path, default=Path("out/gpu_gates.json"), help="file (default: %(default)s)")
    parser.add_argument("--rehearse", action="store_true", help="on the CPU, which tells whether all of this runs")
    parser.add_argument("--job", choices=JOBS, help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    machine = Machine.rehearsed() if args.rehearse else Machine.found()
    frames = min(args.frames, _REHEARSED_FRAMES) if args.rehearse else args.frames
    if args.job:
        for gate in JOBS[args.job][0](machine, frames):
            sys.stdout.write(json.dumps(gate._asdict()) + "\n")
            sys.stdout.flush()
        return 0
    sys.stdout.write(f"{machine.name}\n")
    gates: list[GpuGate] = []
    start = time.monotonic()
    for gate in all_measured(machine, args.only, frames, args.minutes):
        gates.append(gate)
        sys.stdout.write(f"{gate}\n")
        sys.stdout.flush()
        _keep(args.json, machine, gates, time.monotonic() - start)
    held = [gate for gate in gates if gate.asked != "ends"] if args.rehearse else []
    return 0 if len(held) == len(gates) or all(gate.holds for gate in gates) else 1


def _keep(path: Path, machine: Machine, gates: list[GpuGate], seconds: float) -> None:
    """Write what has been measured until now."""
    known = {"machine": machine.name, "seconds": round(seconds, 1), "gates": [gate._asdict() for gate in gates]}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(known, indent=1) + "\n")
    except OSError as error:
        raise LiveHandError(f"the gates' file {path} must be writable, got: {error}; name another by --json") from error


if __name__ == "__main__":
    sys.exit(main())
