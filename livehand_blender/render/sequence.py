"""A sequence of frames on disk: the road of `livehand render`.

Blender's own animation render keeps broken frames for ever and says FINISHED when it failed. Here each frame is
rendered once, saved under a temporary name in the output folder, decoded, and renamed; a frame that is there and
decodes is skipped. Whatever stops the run, no half-written frame carries a frame's name.

While Blender evaluates, composites and saves one frame, a thread of `frame_queue.py` renders the next.
"""

from __future__ import annotations

import contextlib
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy

from ...backend.errors import LiveHandError
from ..scene.camera import output_size_px, read_camera
from ..stdout import blender_silenced
from .engine import LiveHandRender
from .frame_file import BrokenFrameError, check_frame, is_finished
from .interruption import Interruption
from .output import OutputSettings, literal_path
from .plan import SequencePlan, apply_plan, blender_message, frame_path, open_shot


@dataclass(frozen=True)
class FrameJob:
    """The `number`th frame of a sequence, and its files that are not there yet."""

    frame: int
    number: int
    missing: Sequence[Path]


@dataclass(frozen=True)
class FrameProgress:
    """One frame is done: the `number`th of `count`; `seconds` is None where it was there already."""

    frame: int
    number: int
    count: int
    seconds: float | None


@dataclass(frozen=True)
class SequenceReport:
    """What was done; `seconds_per_frame` is the median over the frames written, 0 if none was."""

    folder: Path
    written: int
    skipped: int
    seconds_per_frame: float


def write_sequence(plan: SequencePlan, on_frame: Callable[[FrameProgress], None]) -> SequenceReport:
    """Render what is missing of a sequence.

    Args:
        plan: what to render.
        on_frame: called after each frame.

    Raises:
        LiveHandError: the folder, the .blend, the scene or the avatar is at fault; finished frames stay.
        KeyboardInterrupt: Ctrl-C; finished frames stay.
    """
    seconds: list[float | None] = []
    session = LiveHandRender.required_session()
    with _writable_folder(plan.folder), Interruption() as interruption, session.queueing() as queue:
        with blender_silenced():
            scene = open_shot(plan.shot)
        apply_plan(scene, plan)
        output = OutputSettings.of_scene(scene)
        frames = plan.frames or range(scene.frame_start, scene.frame_end + 1, scene.frame_step)
        for job, following in _jobs(plan, scene, frames):
            interruption.check()
            queue.begin(job.frame, following.frame if following and following.missing else None)
            seconds.append(_write_frame(scene, job, output, interruption) if job.missing else None)
            on_frame(FrameProgress(job.frame, job.number, len(frames), seconds[-1]))
    written = [s for s in seconds if s is not None]
    return SequenceReport(
        plan.folder, len(written), len(seconds) - len(written), statistics.median(written) if written else 0.0
    )


def _jobs(
    plan: SequencePlan, scene: bpy.types.Scene, frames: Sequence[int]
) -> Iterator[tuple[FrameJob, FrameJob | None]]:
    """Each frame's job with the one that follows it; files are looked for no earlier than that."""
    jobs = (FrameJob(frame, number, _missing_files(plan, scene, frame)) for number, frame in enumerate(frames, 1))
    job = next(jobs, None)
    while job:
        following = next(jobs, None)
        yield job, following
        job = following


def _missing_files(plan: SequencePlan, scene: bpy.types.Scene, frame: int) -> list[Path]:
    size_px = output_size_px(scene.render)
    paths = [frame_path(plan, frame, file_format) for file_format in plan.formats]
    return [path for path in paths if plan.overwrite or not is_finished(path, size_px)]


def _write_frame(scene: bpy.types.Scene, job: FrameJob, output: OutputSettings, interruption: Interruption) -> float:
    """Render a frame once and save it to every path it lacks; returns the seconds it took."""
    start = time.perf_counter()
    first, *others = job.missing
    with blender_silenced():
        scene.frame_set(job.frame)
        with _whole_or_untouched(first, output_size_px(scene.render)) as part:
            output.use(scene, first.suffix[1:])
            _render(scene, job.frame, part, interruption)
            interruption.check()
        for path in others:
            with _whole_or_untouched(path, output_size_px(scene.render)) as part:
                output.use(scene, path.suffix[1:])
                bpy.data.images["Render Result"].save_render(str(part), scene=scene)
                interruption.check()
    return time.perf_counter() - start


def _render(scene: bpy.types.Scene, frame: int, path: Path, interruption: Interruption) -> None:
    """Render and save by one operator: it lets the queue's thread have Python meanwhile, `save_render` does not."""
    scene.render.filepath = literal_path(path)
    try:
        read_camera(scene.camera, scene.render)  # Blender's own message on a missing camera tells no remedy
        result = bpy.ops.render.render(scene=scene.name, write_still=True)
    except (RuntimeError, LiveHandError) as error:
        interruption.check()  # a second Ctrl-C, pressed while the engine waits, ends the operator as an error does
        raise LiveHandError(f"frame {frame}: {blender_message(error)}") from error
    if "FINISHED" not in result:
        raise LiveHandError(f"frame {frame}: Blender did not render it ({', '.join(result)})")


@contextlib.contextmanager
def _whole_or_untouched(path: Path, size_px: tuple[int, int]) -> Iterator[Path]:
    """A temporary name to save under: what is saved is decoded and takes the name `path`, or is removed."""
    part = path.with_name(f".{path.stem}.part{path.suffix}").absolute()
    try:
        yield part
        check_frame(part, size_px)
        part.replace(path)
    except (RuntimeError, OSError, BrokenFrameError) as error:
        raise LiveHandError(f"{path} could not be written: {blender_message(error)}; is the disk full?") from error
    finally:
        part.unlink(missing_ok=True)


@contextlib.contextmanager
def _writable_folder(folder: Path) -> Iterator[None]:
    """Make the folder and see that it takes files; one that was made for nothing is removed again.

    Raises:
        LiveHandError: it cannot be made or written to.
    """
    is_new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise LiveHandError(
            f"the output folder {folder} must be writable ({error.strerror}); choose another"
        ) from error
    try:
        yield
    finally:
        if is_new and not any(folder.iterdir()):
            folder.rmdir()
