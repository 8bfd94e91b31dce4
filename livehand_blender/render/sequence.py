"""Sequences of frames on disk: what `livehand render` does for each shot.

Blender's own animation render keeps broken frames and reports FINISHED when it has failed. Here each frame is leased,
rendered once, saved under a temporary name in the output folder, decoded, and renamed; a frame that exists and decodes
is skipped. Whatever stops the run, no incomplete file has a frame's name.

While Blender evaluates, composites and saves one frame, the thread of `frame_queue.py` renders the next.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from ...backend.batch.folders import writable_folder
from ...backend.batch.frame_paths import FramePaths, frames_with_leftovers
from ...backend.batch.interruption import Interruption
from ...backend.batch.leases import FrameLeases, Lease
from ...backend.batch.progress import EventHandler, Failed, FrameProgress, FrameState, ShotOpened, Warned
from ...backend.batch.report import RunReport
from ...backend.records.errors import LiveHandError
from ...backend.system.stdout import blender_silenced
from ..scene.camera import output_size_px
from .engine import LiveHandRender
from .frame_writer import FrameWriter
from .plan import OutputSettings, SequencePlan, apply_plan, open_shot, unreadable_images


def write_sequences(plans: Sequence[SequencePlan], report: RunReport) -> None:
    """Render several shots; one that fails is reported and does not stop the others."""
    for plan in plans:
        on_event = report.handler(plan.shot)
        try:
            write_sequence(plan, on_event)
        except LiveHandError as error:
            on_event(Failed(str(error)))


def write_sequence(plan: SequencePlan, on_event: EventHandler) -> None:
    """Render the frames of a sequence that are missing and not being rendered by another process.

    Args:
        plan: what to render.
        on_event: called when the shot is open, and after each frame.

    Raises:
        LiveHandError: the folder, the .blend, the scene or the avatar is at fault; finished frames are kept.
        KeyboardInterrupt: Ctrl-C, or a signal such as SIGTERM; finished frames are kept.
    """
    session = LiveHandRender.required_session()
    with (
        writable_folder(plan.folder) as now_ns,
        session.queueing() as queue,
        Interruption(queue.stop) as interruption,
        FrameLeases(plan.folder, plan.shot.stem) as leases,
    ):
        with blender_silenced():
            scene = open_shot(plan.shot)
        for name, reason in unreadable_images():
            on_event(Warned(f"image '{name}' cannot be read ({reason}); Blender renders without it"))
        output = OutputSettings.of_scene(scene)
        apply_plan(scene, plan)
        frames = plan.frames_of(scene)
        on_event(ShotOpened(str(plan.folder), len(frames)))
        since_ns = (plan.began_ns or now_ns) if plan.overwrite else 0
        writer = FrameWriter(scene, plan.shot, output, session, queue, interruption)
        _Sequence(plan, frames, output_size_px(scene.render), writer, leases, since_ns, on_event).write()


@dataclass(frozen=True)
class FrameJob:
    """A frame, and, if it must be rendered, its lease and the formats that it lacks."""

    number: int
    frame: int
    lease: Lease | None = None
    formats: Sequence[str] = ()


@dataclass(frozen=True)
class _Sequence:
    """An opened shot whose frames are written.

    Attributes:
        plan: what to render.
        frames: their numbers.
        size_px: of their files.
        writer: of each frame.
        leases: on the frames.
        since_ns: older files count as missing.
        on_event: called after each frame.
    """

    plan: SequencePlan
    frames: Sequence[int]
    size_px: tuple[int, int]
    writer: FrameWriter
    leases: FrameLeases
    since_ns: int
    on_event: EventHandler

    def write(self) -> None:
        """Write the frames, and again those that others had leased, as long as that makes progress."""
        self._clean_up()
        before, waiting = len(self.frames), self._write_unleased(enumerate(self.frames, 1))
        while waiting and len(waiting) < before:
            before, waiting = len(waiting), self._write_unleased(waiting)
        for number, frame in waiting:
            self._report(number, frame, "left")
        self._clean_up()  # a worker may have been killed since, after its frame was finished

    def _clean_up(self) -> None:
        """Remove leases and temporary files that killed runs of this shot left."""
        for frame in frames_with_leftovers(self.plan.folder, self.plan.shot.stem):
            lease = self.leases.acquire(frame)
            if lease:
                self._paths(frame).remove_parts()
                self.leases.release(lease)

    def _write_unleased(self, frames: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
        """Write or skip the frames that no other process has leased; returns those that one has."""
        leased: list[tuple[int, int]] = []
        for job, following in _with_next(self._jobs(frames, leased)):
            self.writer.interruption.check()
            self.writer.queue.begin(job.frame, following.frame if following and following.lease else None)
            if job.lease:
                self._write(job, job.lease)
            else:
                self._report(job.number, job.frame, "skipped")
        return leased

    def _jobs(self, frames: Iterable[tuple[int, int]], leased: list[tuple[int, int]]) -> Iterator[FrameJob]:
        """Each finished frame, and each other frame after leasing it; frames of others are appended to `leased`."""
        for number, frame in frames:
            if not self._missing(frame):
                yield FrameJob(number, frame)
                continue
            lease = self.leases.acquire(frame)
            if lease is None:
                leased.append((number, frame))
                continue
            missing = self._missing(frame)  # again: the last owner may just have finished it
            if missing:
                yield FrameJob(number, frame, lease, missing)
            else:
                self.leases.release(lease)
                yield FrameJob(number, frame)

    def _write(self, job: FrameJob, lease: Lease) -> None:
        start = time.perf_counter()
        is_published = self.writer.write(self._paths(job.frame), job.formats, self.leases, lease)
        if not is_published and self.leases.is_lost(lease) and self._missing(job.frame):
            raise LiveHandError(
                f"the output folder {self.plan.folder} must stay while frames are rendered, the lease of frame "
                f"{job.frame} is gone; run the same command again"
            )
        self.leases.release(lease)
        if is_published:
            self._report(job.number, job.frame, "written", time.perf_counter() - start)
        else:
            self._report(job.number, job.frame, "left")

    def _report(self, number: int, frame: int, state: FrameState, seconds: float | None = None) -> None:
        self.on_event(FrameProgress(frame, number, len(self.frames), state, seconds))

    def _missing(self, frame: int) -> list[str]:
        return self._paths(frame).missing(self.plan.formats, self.size_px, self.since_ns)

    def _paths(self, frame: int) -> FramePaths:
        return FramePaths(self.plan.folder, self.plan.shot.stem, frame)


def _with_next(jobs: Iterator[FrameJob]) -> Iterator[tuple[FrameJob, FrameJob | None]]:
    """Each job with the one that follows it, which is leased only then."""
    job = next(jobs, None)
    while job:
        following = next(jobs, None)
        yield job, following
        job = following
