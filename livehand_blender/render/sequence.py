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
from pathlib import Path

import bpy

from ...backend.errors import LiveHandError
from ..scene.camera import output_size_px, read_camera
from ..scene.images import unreadable_images
from ..stdout import blender_silenced
from .claims import Claim, Claims
from .engine import LiveHandRender
from .folders import writable_folder
from .frame_files import FrameFiles, FrameParts, frames_with_leftovers, not_written
from .frame_queue import FrameQueue
from .interruption import Interruption
from .output import OutputSettings, literal_path
from .plan import SequencePlan, apply_plan, blender_message, open_shot
from .progress import FrameProgress, FrameState, ShotOpened, Tell, Warned
from .provenance import HandRecord, frame_record, save_record
from .session import Session


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
        Claims(plan.folder, plan.shot.stem) as claims,
    ):
        with blender_silenced():
            scene = open_shot(plan.shot)
        for name, reason in unreadable_images():
            tell(Warned(f"image '{name}' cannot be read ({reason}); Blender renders without it"))
        output = OutputSettings.of_scene(scene)
        apply_plan(scene, plan)
        tell(ShotOpened(str(plan.folder), len(plan.frames_of(scene))))
        since_ns = (plan.began_ns or now_ns) if plan.overwrite else 0
        _Sequence(plan, scene, output, session, queue, claims, interruption, since_ns).write(tell)


@dataclass(frozen=True)
class FrameJob:
    """A frame to render, claimed, and the formats it lacks; no claim where nothing is to be done."""

    number: int
    frame: int
    claim: Claim | None
    missing: Sequence[str] = ()


@dataclass(frozen=True)
class _Sequence:
    """An opened shot on its way to disk; `since_ns`: older files count as missing."""

    plan: SequencePlan
    scene: bpy.types.Scene
    output: OutputSettings
    session: Session
    queue: FrameQueue
    claims: Claims
    interruption: Interruption
    since_ns: int

    def write(self, tell: Tell) -> None:
        """Go through the frames, and again through those that others had claimed while that gets us any further."""
        self._clean_up()
        frames = list(enumerate(self.plan.frames_of(self.scene), 1))
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
                self._files(frame).remove_parts()
                self.claims.give_back(claim)

    def _go_through(self, frames: Sequence[tuple[int, int]], count: int, tell: Tell) -> list[tuple[int, int]]:
        """Write, or skip, what nobody else is rendering; returns what somebody is."""
        left: list[tuple[int, int]] = []
        for job, following in _with_next(self._jobs(frames, left)):
            self.interruption.check()
            self.queue.begin(job.frame, following.frame if following and following.claim else None)
            start = time.perf_counter()
            state: FrameState = self._write_frame(job, job.claim) if job.claim else "skipped"
            seconds = time.perf_counter() - start if state == "written" else None
            tell(FrameProgress(job.frame, job.number, count, state, seconds))
        return left

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
                self.claims.give_back(claim)
            yield FrameJob(number, frame, claim if missing else None, missing)

    def _missing(self, frame: int) -> list[str]:
        return self._files(frame).missing(self.plan.formats, output_size_px(self.scene.render), self.since_ns)

    def _files(self, frame: int) -> FrameFiles:
        return FrameFiles(self.plan.folder, self.plan.shot.stem, frame)

    def _write_frame(self, job: FrameJob, claim: Claim) -> FrameState:
        """Render a frame once and save it in every format it lacks, and its record beside it."""
        files = self._files(job.frame)
        if claim.generation:
            files.remove_parts()
        with blender_silenced(), files.parts(claim.token) as parts:
            record_path = parts.path("json")  # the first to be published: no frame is ever without it
            self.scene.frame_set(job.frame)
            self._save_images(job, parts)
            self._save_record(job.frame, record_path)
            is_ours = self.claims.holds(claim)
            if is_ours:
                parts.publish()
        self.claims.give_back(claim)
        return "written" if is_ours else "left"

    def _save_images(self, job: FrameJob, parts: FrameParts) -> None:
        for file_format in job.missing:
            part = parts.path(file_format)
            self.output.use(self.scene, file_format)
            if file_format == job.missing[0]:
                self._render(job.frame, part)
            else:
                self._save_again(part)
            self.interruption.check()
            parts.check(part, output_size_px(self.scene.render))

    def _render(self, frame: int, path: Path) -> None:
        """Render and save by one operator: it lets the queue's thread have Python meanwhile, `save_render` does not."""
        self.scene.render.filepath = literal_path(path)
        try:
            read_camera(self.scene.camera, self.scene.render)  # Blender's message on a missing camera tells no remedy
            result = bpy.ops.render.render(scene=self.scene.name, write_still=True)
        except (RuntimeError, LiveHandError) as error:
            self.interruption.check()  # Ctrl-C, pressed while the engine works, may end the operator as an error does
            raise LiveHandError(f"frame {frame}: {blender_message(error)}") from error
        if "FINISHED" not in result:
            raise LiveHandError(f"frame {frame}: Blender did not render it ({', '.join(result)})")

    def _save_again(self, path: Path) -> None:
        try:
            bpy.data.images["Render Result"].save_render(str(path), scene=self.scene)
        except RuntimeError as error:
            raise not_written(path, blender_message(error)) from error

    def _save_record(self, frame: int, path: Path) -> None:
        tasks = self.queue.asked
        hands = [
            HandRecord(
                task.shot.pose,
                task.renderer.avatar.name,
                self.session.avatar_path(task.renderer),
                task.renderer.hand.sha256,
            )
            for task in tasks
        ]
        size_px = output_size_px(self.scene.render)
        camera = tasks[0].shot.camera if tasks else None
        try:
            save_record(frame_record(self.plan.shot, frame, size_px, camera, hands), path)
        except OSError as error:
            raise not_written(path, str(error.strerror)) from error


def _with_next(jobs: Iterator[FrameJob]) -> Iterator[tuple[FrameJob, FrameJob | None]]:
    """Each job with the one that follows it, which is looked for, and claimed, no earlier than that."""
    job = next(jobs, None)
    while job:
        following = next(jobs, None)
        yield job, following
        job = following
