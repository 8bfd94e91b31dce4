"""A sequence of frames on disk: one shot's road in `livehand render`.

Blender's own animation render keeps broken frames for ever and says FINISHED when it failed. Here each frame is
claimed, rendered once, saved under a temporary name in the output folder, decoded, and renamed; a frame that is there
and decodes is skipped. Whatever stops the run, no half-written frame carries a frame's name.

While Blender evaluates, composites and saves one frame, a thread of `frame_queue.py` renders the next.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ...backend.batch.folders import writable_folder
from ...backend.batch.frame_paths import FramePaths, frames_with_leftovers
from ...backend.batch.interruption import Interruption
from ...backend.batch.leases import FrameLeases, Lease
from ...backend.batch.progress import FrameProgress, FrameState, ShotOpened, Tell, Warned
from ...backend.runtime.stdout import blender_silenced
from ..scene.camera import output_size_px
from ..scene.images import unreadable_images
from .engine import LiveHandRender
from .frame_writer import FrameWriter
from .output import OutputSettings
from .plan import SequencePlan, apply_plan, open_shot


def write_sequence(plan: SequencePlan, tell: Tell) -> None:
    """Render what is missing of a sequence and not being rendered by another process.

    Args:
        plan: what to render.
        tell: told when the shot is open, and after each frame.

    Raises:
        LiveHandError: the folder, the .blend, the scene or the avatar is at fault; finished frames stay.
        KeyboardInterrupt: Ctrl-C or SIGTERM; finished frames stay.
    """
    session = LiveHandRender.required_session()
    with (
        writable_folder(plan.folder) as now_ns,
        session.queueing() as queue,
        Interruption(queue.stop) as interruption,
        FrameLeases(plan.folder, plan.shot.stem) as claims,
    ):
        with blender_silenced():
            scene = open_shot(plan.shot)
        for name, reason in unreadable_images():
            tell(Warned(f"image '{name}' cannot be read ({reason}); Blender renders without it"))
        output = OutputSettings.of_scene(scene)
        apply_plan(scene, plan)
        frames = plan.frames_of(scene)
        tell(ShotOpened(str(plan.folder), len(frames)))
        since_ns = (plan.began_ns or now_ns) if plan.overwrite else 0
        writer = FrameWriter(scene, plan.shot, output, session, queue, interruption)
        _Sequence(plan, frames, output_size_px(scene.render), writer, claims, since_ns).write(tell)


@dataclass(frozen=True)
class FrameJob:
    """A frame to render, claimed, and the formats it lacks; no claim where nothing is to be done."""

    number: int
    frame: int
    claim: Lease | None
    missing: Sequence[str] = ()


@dataclass(frozen=True)
class _Sequence:
    """An opened shot on its way to disk.

    Attributes:
        plan: what was asked for.
        frames: numbers of the frames.
        size_px: of their files.
        writer: of each frame.
        claims: on them.
        since_ns: older files count as missing.
    """

    plan: SequencePlan
    frames: Sequence[int]
    size_px: tuple[int, int]
    writer: FrameWriter
    claims: FrameLeases
    since_ns: int

    def write(self, tell: Tell) -> None:
        """Go through the frames, and again through those that others had claimed while that gets us any further."""
        self._clean_up()
        frames = list(enumerate(self.frames, 1))
        count, waiting, seen = len(frames), frames, len(frames) + 1
        while waiting and len(waiting) < seen:
            seen, waiting = len(waiting), self._go_through(waiting, count, tell)
        for number, frame in waiting:
            tell(FrameProgress(frame, number, count, "left"))

    def _clean_up(self) -> None:
        """Remove what killed runs left of this shot."""
        for frame in frames_with_leftovers(self.plan.folder, self.plan.shot.stem):
            claim = self.claims.take(frame)
            if claim:
                self._paths(frame).remove_parts()
                self.claims.release(claim)

    def _go_through(self, frames: Sequence[tuple[int, int]], count: int, tell: Tell) -> list[tuple[int, int]]:
        """Write, or skip, what nobody else is rendering; returns what somebody is."""
        left: list[tuple[int, int]] = []
        for job, following in _with_next(self._jobs(frames, left)):
            self.writer.interruption.check()
            self.writer.queue.begin(job.frame, following.frame if following and following.claim else None)
            start = time.perf_counter()
            state = self._write(job.frame, job.missing, job.claim) if job.claim else "skipped"
            seconds = time.perf_counter() - start if state == "written" else None
            tell(FrameProgress(job.frame, job.number, count, state, seconds))
        return left

    def _write(self, frame: int, formats: Sequence[str], claim: Lease) -> FrameState:
        is_published = self.writer.write(self._paths(frame), formats, self.claims, claim)
        self.claims.release(claim)
        return "written" if is_published else "left"

    def _jobs(self, frames: Sequence[tuple[int, int]], left: list[tuple[int, int]]) -> Iterator[FrameJob]:
        """Each frame that is there, and each that now is claimed by us; the others are added to `left`."""
        for number, frame in frames:
            if not self._missing(frame):
                yield FrameJob(number, frame, None)
                continue
            claim = self.claims.take(frame)
            if claim is None:
                left.append((number, frame))
                continue
            missing = self._missing(frame)  # the last owner may just have finished it
            if not missing:
                self.claims.release(claim)
            yield FrameJob(number, frame, claim if missing else None, missing)

    def _missing(self, frame: int) -> list[str]:
        return self._paths(frame).missing(self.plan.formats, self.size_px, self.since_ns)

    def _paths(self, frame: int) -> FramePaths:
        return FramePaths(self.plan.folder, self.plan.shot.stem, frame)


def _with_next(jobs: Iterator[FrameJob]) -> Iterator[tuple[FrameJob, FrameJob | None]]:
    """Each job with the one that follows it, which is looked for, and claimed, no earlier than that."""
    job = next(jobs, None)
    while job:
        following = next(jobs, None)
        yield job, following
        job = following
