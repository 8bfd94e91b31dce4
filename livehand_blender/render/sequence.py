"""Sequences of frames on disk: what `livehand render` does for each shot.

Blender's own animation render keeps broken frames and reports FINISHED when it has failed. Here each frame is leased,
rendered once, saved under a temporary name in the output folder, decoded, and renamed; a frame that exists and decodes
is skipped. Whatever stops the run, no incomplete file has a frame's name.

While Blender evaluates, composites and saves one frame, the thread of `frame_queue.py` renders the next.

A run ends when every frame of its list is there: at the end of the list it waits for those that other processes have
leased, until they are finished or their leases are dead, as a farm takes a run's end for the end of its frames.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from ...backend.batch.digests import file_digest
from ...backend.batch.folders import writable_folder
from ...backend.batch.frame_paths import FramePaths, frames_with_leftovers
from ...backend.batch.frame_records import record_of
from ...backend.batch.interruption import Interruption
from ...backend.batch.leases import FrameLeases, Lease
from ...backend.batch.progress import EventHandler, Failed, FrameProgress, FrameState, ShotOpened, Warned
from ...backend.batch.report import RunReport
from ...backend.batch.shot_version import ShotVersion
from ...backend.records.errors import LiveHandError
from ...backend.system.command import blender_silenced
from .engine import LiveHandRender
from .file_outputs import apply_file_outputs
from .frame_writer import FrameWriter
from .plan import OutputSettings, SequencePlan, apply_plan, open_shot, unreadable_images
from .shot_version import read_version

_LOOK_AGAIN_S = 1.0
"""How often a run that waits looks for the frames of other processes."""


def write_sequences(plans: Sequence[SequencePlan], report: RunReport) -> None:
    """Render several shots; one that fails is reported and does not stop the others."""
    for plan in plans:
        on_event = report.handler(plan.shot)
        try:
            write_sequence(plan, on_event)
        except LiveHandError as error:
            on_event(Failed(str(error)))


def write_sequence(plan: SequencePlan, on_event: EventHandler) -> None:
    """Render the frames of a sequence that are missing, and wait for those that other processes are rendering.

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
        opened = file_digest(plan.shot)
        with blender_silenced():
            scene = open_shot(plan.shot)
        for name, reason in unreadable_images():
            on_event(Warned(f"image '{name}' cannot be read ({reason}); Blender renders without it"))
        output = OutputSettings.of_scene(scene)
        apply_plan(scene, plan)
        if doubt := apply_file_outputs(scene, plan.folder, plan.file_outputs):
            on_event(Warned(doubt))
        frames, version = plan.frames_of(scene), read_version(scene, plan.shot, opened, plan.folder)
        on_event(ShotOpened(str(plan.folder), len(frames), version.digest()))
        since_ns = (plan.began_ns or now_ns) if plan.overwrite else 0
        writer = FrameWriter(scene, plan.shot, version, output, session, queue, interruption, plan.signing)
        _Sequence(plan, frames, version, writer, leases, since_ns, on_event).write()


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
        version: of the shot.
        writer: of each frame.
        leases: on the frames.
        since_ns: older files count as missing.
        on_event: called after each frame.
        lost: frames whose leases somebody else removed while they were rendered.
    """

    plan: SequencePlan
    frames: Sequence[int]
    version: ShotVersion
    writer: FrameWriter
    leases: FrameLeases
    since_ns: int
    on_event: EventHandler
    lost: set[int] = field(default_factory=set)

    def write(self) -> None:
        """Write the frames, and those that others had leased until each is there."""
        self._clean_up()
        if self.plan.is_strict and self._has_others():
            return
        before, waiting = len(self.frames), self._write_unleased(self._numbered)
        while waiting:
            if len(waiting) == before:
                self._wait_for(waiting)
            before, waiting = len(waiting), self._write_unleased(waiting)
        self._clean_up()  # a worker may have been killed since, after its frame was finished
        self._check_that_all_are_there()

    def _has_others(self) -> bool:
        """Return whether frames that stay are of another version; they are reported."""
        found = [(number, frame, self._differences(frame, self._missing(frame))) for number, frame in self._numbered]
        others = [one for one in found if one[-1]]
        for number, frame, differs in others:
            self._report(number, frame, "skipped", differs=differs)
        return bool(others)

    def _wait_for(self, frames: Sequence[tuple[int, int]]) -> None:
        """Wait a moment for frames of other processes."""
        for number, frame in frames:
            self._report(number, frame, "left")
        time.sleep(_LOOK_AGAIN_S)
        self.writer.interruption.check()

    def _check_that_all_are_there(self) -> None:
        gone = [frame for frame in self.frames if not self._paths(frame).exist(self.plan.formats)]
        if gone:
            raise self._must_stay(f"{len(gone)} of {len(self.frames)} frames are gone")

    def _must_stay(self, got: str) -> LiveHandError:
        return LiveHandError(
            f"the output folder {self.plan.folder} must stay while frames are rendered, {got}; run the same command "
            "again"
        )

    def _clean_up(self) -> None:
        """Remove leases and temporary files that killed runs of this shot left."""
        for frame in frames_with_leftovers(self.plan.folder, self.plan.shot.stem):
            lease = self.leases.acquire(frame)
            if lease:
                self._paths(frame).remove_parts()
                self.leases.release(lease)

    def _write_unleased(self, frames: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
        """Write or skip the frames that no other process has leased; returns those that one has, or took over."""
        leased: list[tuple[int, int]] = []
        for job, following in _with_next(self._jobs(frames, leased)):
            self.writer.interruption.check()
            self.writer.queue.begin(job.frame, following.frame if following and following.lease else None)
            if not job.lease:
                self._report(job.number, job.frame, "skipped", differs=self._differences(job.frame))
            elif not self._write(job, job.lease):
                leased.append((job.number, job.frame))
        return leased

    def _jobs(self, frames: Iterable[tuple[int, int]], leased: list[tuple[int, int]]) -> Iterator[FrameJob]:
        """Yield each finished frame, and each other frame after leasing it; append frames of others to `leased`."""
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

    def _write(self, job: FrameJob, lease: Lease) -> bool:
        """Write a leased frame; returns False if the lease was taken over or removed meanwhile."""
        start = time.perf_counter()
        is_published = self.writer.write(self._paths(job.frame), job.formats, self.leases, lease)
        if not is_published and self.leases.is_lost(lease) and self._missing(job.frame):
            self._lose(job.frame)
        self.leases.release(lease)
        if is_published:
            differs = self._differences(job.frame, job.formats)
            self._report(job.number, job.frame, "written", time.perf_counter() - start, differs)
        return is_published

    def _lose(self, frame: int) -> None:
        """Take note of a frame whose lease is gone: its next owner was interrupted, or the folder was deleted.

        Raises:
            LiveHandError: it happens again.
        """
        if frame in self.lost:
            raise self._must_stay(f"the lease of frame {frame} is gone")
        self.lost.add(frame)

    def _report(
        self, number: int, frame: int, state: FrameState, seconds: float | None = None, differs: tuple[str, ...] = ()
    ) -> None:
        self.on_event(FrameProgress(frame, number, len(self.frames), state, seconds, differs))

    def _differences(self, frame: int, rendered: Sequence[str] = ()) -> tuple[str, ...]:
        """List in what a frame's files, but for those of these formats, differ from what would be rendered now."""
        staying = [name for name in self.plan.formats if name not in rendered]
        records = self._paths(frame).records(staying) if staying else []
        found = [self.version.differences(record_of(records, name)) for name in staying]
        return tuple(dict.fromkeys(key for keys in found for key in keys))

    @property
    def _numbered(self) -> list[tuple[int, int]]:
        return list(enumerate(self.frames, 1))

    def _missing(self, frame: int) -> list[str]:
        return self._paths(frame).missing(self.plan.formats, self.version.size_px, self.since_ns)

    def _paths(self, frame: int) -> FramePaths:
        return FramePaths(self.plan.folder, self.plan.shot.stem, frame)


def _with_next(jobs: Iterator[FrameJob]) -> Iterator[tuple[FrameJob, FrameJob | None]]:
    """Yield each job with the one that follows it, which is leased only then."""
    job = next(jobs, None)
    while job:
        following = next(jobs, None)
        yield job, following
        job = following
