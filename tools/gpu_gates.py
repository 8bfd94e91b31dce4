"""Run the tests of a GPU and time whole frames on it: each of the gates, what was measured, and whether it holds.

python -m livehand.tools.gpu_gates [--frames N] [--skip-tests] [--rehearse]
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from ..backend.avatars.file import load_avatar
from ..backend.hand.model_file import load_default_hand
from ..backend.records.errors import LiveHandError
from ..backend.records.frame import Frame
from ..backend.records.light import Lamp, Light, Sky, rotation_facing
from ..backend.records.shot import Shot
from ..backend.render.relightable import RelightablePipeline
from ..backend.render.renderer import Renderer
from ..backend.research.benchmark.cases import load_paper_avatar
from ..backend.research.benchmark.motion import MovingHand
from ..backend.research.benchmark.published import PublishedRenderer

_TESTS = "tests/test_cuda.py", "tests/compute/gpu"
_REHEARSED_TESTS = ("tests/compute/gpu/test_backend.py",)
_MOST_TEST_S = 100.0
_SMALL = 334, 512
_MOST_MS = {_SMALL: 1.5, (1920, 1080): 4.0, (3840, 2160): 12.0}
_REHEARSED_PX = 64, 96
_LEAST_TIMES_PAPER = 75.0
_WARM_FRAMES = 4


class GpuGate(NamedTuple):
    """What was asked and what was measured."""

    name: str
    asked: str
    measured: str
    holds: bool

    def __str__(self) -> str:
        """Return a line."""
        return f"{'holds' if self.holds else 'FAILS':5}  {self.name}: {self.measured} ({self.asked})"


def three_lamps_and_sky() -> Light:
    """Return the light that the gates are for."""

    def area(position: tuple[float, float, float], power_w: float) -> Lamp:
        at = np.array(position)
        return Lamp("area", np.full(3, power_w), at, rotation_facing(at / np.linalg.norm(at)), size_m=(0.25, 0.25))

    lamps = area((-0.5, -0.6, 0.5), 6.0), area((0.1, 0.6, 0.5), 5.0), area((0.6, -0.4, 0.3), 3.0)
    return Light(lamps, Sky(np.full((16, 32, 3), 0.3)))


def moving_shots(size_px: tuple[int, int], count: int) -> list[Shot]:
    """Return shots of a hand that moves, in that light."""
    motion, light = MovingHand(load_default_hand(), size_px), three_lamps_and_sky()
    return [replace(motion.shot(frame), light=light) for frame in motion.frames(count)]


def median_ms(render, shots: list[Shot]) -> float:
    """Time frames from shot to pixels on the host, after some to warm up."""
    times, warm = [], shots[:_WARM_FRAMES]
    for number, shot in enumerate([*warm, *shots]):
        start = time.perf_counter()
        render(shot)
        if number >= len(warm):
            times.append(1e3 * (time.perf_counter() - start))
    return statistics.median(times)


class Machine(NamedTuple):
    """Where the gates are measured.

    Attributes:
        name: of it.
        warp: Warp's name of the device.
        torch: torch's name of it, for the paper's renderer.
        most_ms: by size of frames, px.
        tests: that are run.
    """

    name: str
    warp: str
    torch: str
    most_ms: dict[tuple[int, int], float]
    tests: tuple[str, ...]

    @classmethod
    def found(cls) -> Machine:
        """Return the GPU.

        Raises:
            LiveHandError: there is none, or torch has no CUDA for the paper's renderer beside it.
        """
        if not torch.cuda.is_available():
            raise LiveHandError(
                "the gates must be measured on an NVIDIA GPU with CUDA's torch, got none; run this there"
            )
        return cls(torch.cuda.get_device_name(), "cuda:0", "cuda", _MOST_MS, _TESTS)

    @classmethod
    def rehearsed(cls) -> Machine:
        """Return the CPU in place of a GPU, for small frames: all is run, and no time says anything."""
        return cls("a rehearsal on the CPU", "cpu", "cpu", {_REHEARSED_PX: float("inf")}, _REHEARSED_TESTS)


def frame_gates(machine: Machine, frames: int) -> list[GpuGate]:
    """Time frames of all sizes, and the paper's renderer as published beside the smallest."""
    from ..backend.compute.gpu.backend import WarpBackend

    hand = load_default_hand()
    renderer = Renderer(load_avatar(), hand, "cpu", "fp32", WarpBackend(machine.warp))
    gates, of_small = [], 0.0
    for size_px, most_ms in machine.most_ms.items():
        took = median_ms(lambda shot: at_once(renderer, shot), moving_shots(size_px, frames))
        of_small = of_small or took
        name = f"frame of {size_px[0]}x{size_px[1]}, Shot to Frame"
        gates.append(GpuGate(name, f"at most {most_ms} ms", f"{took:.2f} ms", took <= most_ms))
    published = PublishedRenderer(load_paper_avatar(hand, None), hand, torch.device(machine.torch))
    shots = moving_shots(next(iter(machine.most_ms)), min(frames, 8))
    paper = median_ms(lambda shot: published.render(shot, lambda _: None), shots)
    times = paper / of_small
    asked = f"at least {_LEAST_TIMES_PAPER:.0f} times as fast"
    gates.append(
        GpuGate(f"the paper as published ({paper:.0f} ms)", asked, f"{times:.1f} times", times >= _LEAST_TIMES_PAPER)
    )
    return gates


@torch.inference_mode()
def at_once(renderer: Renderer, shot: Shot) -> Frame:
    """Render a frame as one.

    Raises:
        LiveHandError: it was not, and a gate would time its stages.
    """
    pipeline = renderer.pipeline
    assert isinstance(pipeline, RelightablePipeline)
    frame = pipeline.at_once(shot)
    if frame is None:
        raise LiveHandError("a frame of the gates must be rendered at once, got one for stages; see its warning")
    return frame


def gate_of_tests(tests: tuple[str, ...]) -> GpuGate:
    """Run tests that need a GPU."""
    start = time.perf_counter()
    root = Path(__file__).parents[1]
    done = subprocess.run([sys.executable, "-m", "pytest", "-q", *tests], cwd=root, check=False)
    took = time.perf_counter() - start
    passed = "passed" if done.returncode == 0 else "FAILED"
    holds = done.returncode == 0 and took <= _MOST_TEST_S
    return GpuGate("tests on the GPU", f"pass within {_MOST_TEST_S:.0f} s", f"{passed}, {took:.0f} s", holds)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure all; returns 1 if a gate does not hold, but 0 after a rehearsal."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=50, help="of each size (default: %(default)s)")
    parser.add_argument("--skip-tests", action="store_true", help="only time frames")
    parser.add_argument("--rehearse", action="store_true", help="on the CPU, which tells whether all of this runs")
    args = parser.parse_args(argv)
    machine = Machine.rehearsed() if args.rehearse else Machine.found()
    gates = [] if args.skip_tests else [gate_of_tests(machine.tests)]
    gates += frame_gates(machine, args.frames)
    sys.stdout.write("\n".join([machine.name, *map(str, gates)]) + "\n")
    return 0 if args.rehearse or all(gate.holds for gate in gates) else 1


if __name__ == "__main__":
    sys.exit(main())
