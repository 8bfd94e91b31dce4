"""What the gates of a GPU measure: frames, a batch, a training step, and the first frame after an install."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from ..backend.avatars.avatar import PRESETS, AvatarConfig
from ..backend.avatars.file import load_avatar
from ..backend.capture.capture import Capture, CaptureView, SurfaceReference, save_capture_index
from ..backend.capture.lights import CaptureLight
from ..backend.field.field import FieldConfig
from ..backend.field.sampler import SamplerConfig
from ..backend.hand.model_file import load_default_hand
from ..backend.image.frame_writer import FileWriter, write_frame_exr
from ..backend.image.superres import SuperResConfig
from ..backend.records.errors import LiveHandError
from ..backend.records.frame import Frame
from ..backend.records.light import Lamp, Light, Sky, rotation_facing
from ..backend.records.shot import Shot
from ..backend.render.relightable import RelightablePipeline
from ..backend.render.renderer import Renderer
from ..backend.research.benchmark.cases import load_paper_avatar
from ..backend.research.benchmark.motion import MovingHand
from ..backend.research.benchmark.published import PublishedRenderer
from ..backend.surface.surface_file import surface_sha256, write_surface
from ..backend.system.thread_limits import usable_threads
from ..backend.training.config import ReportConfig, TrainConfig
from ..backend.training.loop import train
from ..backend.training.processes import ComputeSetup
from ..backend.training.setup import TrainingSetup

_SIZES_PX = (334, 512), (1920, 1080), (3840, 2160)
_MOST_MS = 1.5, 4.0, 12.0
_REHEARSED_PX = (64, 96), (80, 96), (96, 80)
_LEAST_TIMES_PAPER = 75.0
_LEAST_BATCH_FPS, _BATCH_FRAMES = 60.0, 240
_MOST_STEP_MS = 15.0
_MOST_FIRST_S = 2.0
_WARM_FRAMES = 4
_MOST_PAPER_FRAMES = 8
_VIEWS = 4  # of the capture that is trained on
_REHEARSED = AvatarConfig(
    FieldConfig(width=16, planes=((32, 2, 4),), relief=8, light="linear"),
    SuperResConfig(kind="lit", width=8, depth=2),
    SamplerConfig(4, 0.003),
)


class GpuGate(NamedTuple):
    """What was asked and what was measured."""

    name: str
    asked: str
    measured: str
    holds: bool

    def __str__(self) -> str:
        """Return a line."""
        return f"{'holds' if self.holds else 'FAILS':5}  {self.name}: {self.measured} ({self.asked})"


class Machine(NamedTuple):
    """Where the gates are measured.

    Attributes:
        name: of it.
        warp: Warp's name of the device.
        torch: torch's name of it, for the paper's renderer and training.
        sizes_px: of frames, small first.
        is_rehearsal: whether no time says anything.
    """

    name: str
    warp: str
    torch: str
    sizes_px: tuple[tuple[int, int], ...]
    is_rehearsal: bool

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
        return cls(torch.cuda.get_device_name(), "cuda:0", "cuda", _SIZES_PX, False)

    @classmethod
    def rehearsed(cls) -> Machine:
        """Return the CPU in place of a GPU, for small frames: all is run, and no time says anything."""
        return cls("a rehearsal on the CPU", "cpu", "cpu", _REHEARSED_PX, True)

    @property
    def chip(self) -> int:
        """Compute capability times ten; in a rehearsal that of an H100."""
        import warp as wp

        return 90 if self.is_rehearsal else int(wp.get_device(self.warp).arch)


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


def median_ms(render: Callable[[Shot], object], shots: list[Shot]) -> float:
    """Time frames from shot to pixels on the host, after some to warm up."""
    times, warm = [], shots[:_WARM_FRAMES]
    for number, shot in enumerate([*warm, *shots]):
        start = time.perf_counter()
        render(shot)
        if number >= len(warm):
            times.append(1e3 * (time.perf_counter() - start))
    return statistics.median(times)


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


def renderer_on(machine: Machine) -> Renderer:
    """Return what renders whole frames there."""
    from ..backend.compute.gpu.backend import WarpBackend

    return Renderer(load_avatar(), load_default_hand(), "cpu", "fp32", WarpBackend(machine.warp))


def frame_ms(machine: Machine, size_px: tuple[int, int], frames: int) -> float:
    """Time whole frames of a size."""
    renderer = renderer_on(machine)
    return median_ms(lambda shot: at_once(renderer, shot), moving_shots(size_px, frames))


def gate_of_size(machine: Machine, number: int, frames: int) -> GpuGate:
    """Time frames of one of the sizes."""
    size_px, most_ms = machine.sizes_px[number], _MOST_MS[number]
    return _frame_gate(size_px, most_ms, frame_ms(machine, size_px, frames))


def _frame_gate(size_px: tuple[int, int], most_ms: float, took_ms: float) -> GpuGate:
    name = f"frame of {size_px[0]}x{size_px[1]}, Shot to Frame"
    return GpuGate(name, f"at most {most_ms} ms", f"{took_ms:.2f} ms", took_ms <= most_ms)


def gates_beside_paper(machine: Machine, frames: int) -> list[GpuGate]:
    """Time the smallest frames, and the paper's renderer as published beside them."""
    size_px, hand = machine.sizes_px[0], load_default_hand()
    ours_ms = frame_ms(machine, size_px, frames)
    published = PublishedRenderer(load_paper_avatar(hand, None), hand, torch.device(machine.torch))
    shots = moving_shots(size_px, min(frames, _MOST_PAPER_FRAMES))
    paper_ms = median_ms(lambda shot: published.render(shot, lambda _: None), shots)
    times = paper_ms / ours_ms
    name, asked = f"the paper as published ({paper_ms:.0f} ms)", f"at least {_LEAST_TIMES_PAPER:.0f} times as fast"
    return [
        _frame_gate(size_px, _MOST_MS[0], ours_ms),
        GpuGate(name, asked, f"{times:.1f} times", times >= _LEAST_TIMES_PAPER),
    ]


def gate_of_batch(machine: Machine, frames: int) -> GpuGate:
    """Render frames of the second size, which threads write as EXRs meanwhile, until the last is on disk."""
    renderer, size_px = renderer_on(machine), machine.sizes_px[1]
    shots, count = moving_shots(size_px, 8), min(_BATCH_FRAMES, 5 * frames)
    for shot in shots:
        at_once(renderer, shot)
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        with FileWriter(usable_threads()) as writer:
            for number in range(count):
                writer.write(at_once(renderer, shots[number % len(shots)]), Path(folder) / f"{number:04d}.exr")
        per_second = count / (time.perf_counter() - start)
    name = f"batch of {size_px[0]}x{size_px[1]} EXRs, {usable_threads()} threads to write"
    holds = per_second >= _LEAST_BATCH_FPS
    return GpuGate(name, f"at least {_LEAST_BATCH_FPS:.0f} a second", f"{per_second:.1f} a second", holds)


def gate_of_training(machine: Machine) -> GpuGate:
    """Time the steps by which one training is longer than another; without a perceptual loss."""
    few, many = (1, 2) if machine.is_rehearsal else (40, 240)
    networks = _REHEARSED if machine.is_rehearsal else PRESETS["relightable"]
    with tempfile.TemporaryDirectory() as folder:
        capture = painted_capture(Path(folder), machine.sizes_px[0])
        setup = TrainingSetup(capture, load_default_hand(), networks)
        took = []
        for steps in (few, few, many):  # the first one warms up
            start = time.perf_counter()
            config, compute = TrainConfig(steps=steps), ComputeSetup(torch.device(machine.torch))
            train(setup, config, Path(folder) / f"{len(took)}.safetensors", compute, ReportConfig(preview_minutes=0.0))
            took.append(time.perf_counter() - start)
    step_ms = 1e3 * (took[2] - took[1]) / (many - few)
    holds = 0 < step_ms <= _MOST_STEP_MS  # below 0: what else trainings do took longer than all steps
    return GpuGate("training step", f"at most {_MOST_STEP_MS} ms", f"{step_ms:.1f} ms", holds)


def painted_capture(folder: Path, size_px: tuple[int, int]) -> Capture:
    """Render a capture of the first avatar in a light, with its surface."""
    avatar, hand = load_avatar(), load_default_hand()
    assert avatar.surface is not None
    write_surface(folder / "surface.npz", avatar.surface)
    renderer, shots = Renderer(avatar, hand, "cpu"), moving_shots(size_px, _VIEWS)
    for number, shot in enumerate(shots):
        write_frame_exr(renderer.render(shot), folder / f"{number}.exr")
    views = (
        CaptureView(f"{number}.exr", shot.camera, number, number, "train", light=0) for number, shot in enumerate(shots)
    )
    light = CaptureLight("hard", three_lamps_and_sky())
    reference = SurfaceReference("surface.npz", surface_sha256(avatar.surface))
    known = folder, hand.sha256, {"made_by": "gpu_gates"}, tuple(shot.pose for shot in shots)
    capture = Capture(*known, tuple(views), (light,), reference)
    save_capture_index(capture)
    return capture


def gate_of_kernels(machine: Machine) -> GpuGate:
    """Compile all kernels for the chip to where Warp looks for them; in a rehearsal, one module elsewhere."""
    from ..backend.compute.gpu import ahead
    from ..backend.compute.gpu.kernels import surfels

    start = time.perf_counter()
    if machine.is_rehearsal:
        with tempfile.TemporaryDirectory() as folder:
            ahead.compile_module(surfels.__name__, (machine.chip,), Path(folder))
    else:
        ahead.compile_kernels((machine.chip,))
    took = time.perf_counter() - start
    name = f"all kernels compiled for compute capability {machine.chip / 10}"
    return GpuGate(name, "at most 120 s", f"{took:.0f} s", took <= 120)


def gate_of_first_frame(machine: Machine) -> GpuGate:
    """Time the first frame of this process, after its imports; kernels are compiled, as a release brings them."""
    (shot,) = moving_shots(machine.sizes_px[0], 1)
    start = time.perf_counter()
    at_once(renderer_on(machine), shot)
    took = time.perf_counter() - start
    name = "first frame of a process, from its avatar's file on"
    return GpuGate(name, f"at most {_MOST_FIRST_S:.0f} s", f"{took:.2f} s", took <= _MOST_FIRST_S)
