"""Renders one leased frame with Blender, saves it and its record, checks the files and publishes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import bpy

from ...backend.avatars.metadata import licence_and_consent
from ...backend.batch.content_credentials import SigningKey, sign_file
from ...backend.batch.folders import not_written
from ...backend.batch.frame_paths import FORMATS, FrameParts, FramePaths
from ...backend.batch.frame_records import joined_records, kept_records
from ...backend.batch.interruption import Interruption
from ...backend.batch.leases import FrameLeases, Lease
from ...backend.batch.provenance import HandRecord, frame_record, save_record
from ...backend.batch.shot_version import ShotVersion
from ...backend.records.errors import LiveHandError
from ...backend.render.frame_queue import FrameQueue
from ...backend.render.frame_task import HandTask
from ...backend.render.session import Session
from ...backend.system.command import blender_silenced
from ..scene.camera import output_size_px, read_camera, render_region
from ..scene.file_paths import operator_path, output_path
from .plan import OutputSettings, blender_message


@dataclass(frozen=True)
class FrameWriter:
    """Writes frames of the open scene to disk.

    Attributes:
        scene: with the plan applied.
        shot: the .blend of the scene.
        version: of the shot.
        output: the scene's output settings before the plan was applied.
        session: the engine's session.
        queue: the session's queue.
        interruption: checked after each image.
        signing: signs the PNGs; None: nothing is signed.
    """

    scene: bpy.types.Scene
    shot: Path
    version: ShotVersion
    output: OutputSettings
    session: Session
    queue: FrameQueue
    interruption: Interruption
    signing: SigningKey | None = None

    def write(self, paths: FramePaths, formats: Sequence[str], leases: FrameLeases, lease: Lease) -> bool:
        """Render a frame once, save it in every format, and save its record beside it.

        Returns:
            Whether it was published; it is not if another process has superseded the lease meanwhile.

        Raises:
            LiveHandError: the frame cannot be rendered or saved.
            KeyboardInterrupt: Ctrl-C, or a signal such as SIGTERM.
        """
        if lease.generation:
            paths.remove_parts()
        try:
            return self._write(paths, formats, leases, lease)
        except LiveHandError:
            if leases.holds(lease):
                raise
            return False  # whoever took the frame over, while this process slept, has removed what it had saved

    def _write(self, paths: FramePaths, formats: Sequence[str], leases: FrameLeases, lease: Lease) -> bool:
        with blender_silenced(), FrameParts(paths, lease.token) as parts:
            record_path = parts.path("json")  # published first, so that no frame is ever without it
            self.scene.frame_set(paths.frame)
            self._save_images(paths.frame, formats, parts)
            self._save_record(paths, formats, record_path)
            is_ours = leases.holds(lease)
            if is_ours:
                parts.publish()
        return is_ours

    def _save_images(self, frame: int, formats: Sequence[str], parts: FrameParts) -> None:
        for file_format in formats:
            part = parts.path(file_format)
            self.output.use(self.scene, file_format)
            if file_format == formats[0]:
                self._render(frame, part)
            else:
                self._save_again(part)
            if self.signing is not None and file_format == "png":
                self._sign(part, self.signing)
            self.interruption.check()
            parts.check(part, output_size_px(self.scene.render))

    def _sign(self, path: Path, signing: SigningKey) -> None:
        records = [self._hand_record(task) for task in self._hand_tasks()]
        shown = [{"name": one.avatar_name, "licence": one.licence, "consent": one.consent} for one in records]
        sign_file(path, signing, {"avatars": shown})

    def _render(self, frame: int, path: Path) -> None:
        """Render and save with one operator, which releases Python to the queue's thread; `save_render` does not."""
        self.scene.render.filepath = output_path(path)
        try:
            read_camera(self.scene.camera, self.scene.render)  # Blender's message on a missing camera has no remedy
            result = bpy.ops.render.render(scene=self.scene.name, write_still=True)
        except (RuntimeError, LiveHandError) as error:
            self.interruption.check()  # an interrupted engine may end the operator with an error
            raise LiveHandError(f"frame {frame}: {blender_message(error)}") from error
        if "FINISHED" not in result:
            raise LiveHandError(f"frame {frame}: Blender did not render it ({', '.join(result)})")

    def _save_again(self, path: Path) -> None:
        try:
            bpy.data.images["Render Result"].save_render(operator_path(path), scene=self.scene)
        except RuntimeError as error:
            raise not_written(path, blender_message(error)) from error

    def _save_record(self, paths: FramePaths, formats: Sequence[str], path: Path) -> None:
        """Save a record of the new files, beside those of the frame's others, which are not rendered again."""
        others = [name for name in FORMATS if name not in formats]
        kept = kept_records(paths.records(others), [name for name in others if paths.exist([name])])
        size_px, region = output_size_px(self.scene.render), render_region(self.scene.render)
        camera = read_camera(self.scene.camera, self.scene.render).cropped(region.x0_px, region.y0_px, region.size_px)
        hands = [self._hand_record(task) for task in self._hand_tasks()]
        record = frame_record(self.shot, paths.frame, size_px, camera, hands, formats, self.version)
        try:
            save_record(joined_records(kept, record), path)
        except OSError as error:
            raise not_written(path, str(error.strerror)) from error

    def _hand_tasks(self) -> list[HandTask]:
        """List each hand once, in however many view layers and light groups, at the sample nearest to the frame."""
        tasks: list[HandTask] = []
        for lit in chain(*(submitted.samples[0] for submitted in self.queue.submitted if submitted.samples)):
            task = replace(lit, shot=replace(lit.shot, light=None))
            if not any(task.is_same_as(other) for other in tasks):
                tasks.append(task)
        return tasks

    def _hand_record(self, task: HandTask) -> HandRecord:
        renderer = task.renderer
        licence, consent = licence_and_consent(renderer.avatar.provenance)
        return HandRecord(
            task.shot.pose,
            renderer.avatar.name,
            self.session.avatar_path(renderer),
            renderer.hand.sha256,
            licence,
            consent,
        )
