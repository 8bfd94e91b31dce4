"""Run the tests of a GPU and time whole frames on it: each of the gates, what was measured, and whether it holds.

python -m livehand.tools.gpu_gates [--frames N] [--skip-tests]
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from ..backend.avatars.file import load_avatar
from ..backend.hand.model_file import load_default_hand
from ..backend.records.errors import LiveHandError
from ..backend.records.light import Lamp, Light, Sky, rotation_facing
from ..backend.records.shot import Shot
from ..backend.render.renderer import Renderer
from ..backend.research.benchmark.cases import load_paper_avatar
from ..backend.research.benchmark.motion import MovingHand
from ..backend.research.benchmark.published import PublishedRenderer

_TESTS = "tests/test_cuda.py", "tests/compute/gpu"
_MOST_TEST_S = 100.0
_SMALL = 334, 512
_MOST_MS = {_SMALL: 1.5, (1920, 1080): 4.0, (3840, 2160): 12.0}
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
    times = []
    for number, shot in enumerate([*shots[:_WARM_FRAMES], *shots]):
        start = time.perf_counter()
        render(shot)
        if number >= _WARM_FRAMES:
            times.append(1e3 * (time.perf_counter() - start))
    return statistics.median(times)


def frame_gates(renderer: Renderer, frames: int) -> list[GpuGate]:
    """Time frames of all sizes, and the paper's renderer as published beside the smallest."""
    gates, of_small = [], 0.0
    for size_px, most_ms in _MOST_MS.items():
        took = median_ms(renderer.render, moving_shots(size_px, frames))
        of_small = of_small or took
        name = f"frame of {size_px[0]}x{size_px[1]}, Shot to Frame"
        gates.append(GpuGate(name, f"at most {most_ms} ms", f"{took:.2f} ms", took <= most_ms))
    hand = load_default_hand()
    published = PublishedRenderer(load_paper_avatar(hand, None), hand, torch.device("cuda"))
    paper = median_ms(lambda shot: published.render(shot, lambda _: None), moving_shots(_SMALL, min(frames, 8)))
    times = paper / of_small
    asked = f"at least {_LEAST_TIMES_PAPER:.0f} times as fast"
    gates.append(
        GpuGate(f"the paper as published ({paper:.0f} ms)", asked, f"{times:.1f} times", times >= _LEAST_TIMES_PAPER)
    )
    return gates


def test_gate() -> GpuGate:
    """Run the tests that need a GPU."""
    start = time.perf_counter()
    root = Path(__file__).parents[1]
    done = subprocess.run([sys.executable, "-m", "pytest", "-q", *_TESTS], cwd=root, check=False)
    took = time.perf_counter() - start
    passed = "passed" if done.returncode == 0 else "FAILED"
    holds = done.returncode == 0 and took <= _MOST_TEST_S
    return GpuGate("tests on the GPU", f"pass within {_MOST_TEST_S:.0f} s", f"{passed}, {took:.0f} s", holds)


def main() -> int:
    """Measure all; returns 1 if a gate does not hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=50, help="of each size (default: %(default)s)")
    parser.add_argument("--skip-tests", action="store_true", help="only time frames")
    args = parser.parse_args()
    if not torch.cuda.is_available():
        raise LiveHandError("the gates must be measured on an NVIDIA GPU, got none; run this where there is one")
    from ..backend.compute.gpu.backend import WarpBackend

    renderer = Renderer(load_avatar(), load_default_hand(), "cuda", "fp32", WarpBackend("cuda:0"))
    gates = [] if args.skip_tests else [test_gate()]
    gates += frame_gates(renderer, args.frames)
    lines = [torch.cuda.get_device_name(), *map(str, gates)]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0 if all(gate.holds for gate in gates) else 1


if __name__ == "__main__":
    sys.exit(main())
