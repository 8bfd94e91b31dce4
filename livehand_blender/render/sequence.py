"""A sequence of frames on disk: the road of `livehand render`.

Blender's own animation render keeps broken frames for ever and says FINISHED when it failed. Here each frame is
rendered once, saved under a temporary name in the output folder, decoded, and renamed; a frame that is there and
decodes is skipped. Whatever stops the run, no half-written frame carries a frame's name.
"""

from __future__ import annotations

import contextlib
import signal
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy

from ...backend.errors import LiveHandError
from ..rig.hand import find_hands
from ..scene.camera import output_size_px, read_camera
from ..scene.settings import ENGINE
from ..stdout import blender_silenced
from .frame_file import BrokenFrameError, check_frame, is_finished
from .output import OutputSettings


@dataclass(frozen=True)
class SequencePlan:
    """What to render. None leaves a setting as it is in the .blend.

    Attributes:
        shot: the .blend; it is not changed.
        folder: of the frames; made if missing.
        frames: frame numbers; None takes the scene's range and step.
        formats: of each frame, `exr` (multilayer) and `png`; all come from one render.
        overwrite: render finished frames too.
        avatar: for every hand of the scene.
        size_px: (width, height) at 100 %.
        device: `auto`, `cpu` or `cuda`.
        precision: `fp32` or `bf16`.
    """

    shot: Path
    folder: Path
    frames: Sequence[int] | None = None
    formats: Sequence[str] = ("exr",)
    overwrite: bool = False
    avatar: Path | None = None
    size_px: tuple[int, int] | None = None
    device: str | None = None
    precision: str | None = None


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
    with _writable_folder(plan.folder), _Interruption() as interruption:
        with blender_silenced():
            scene = open_shot(plan.shot)
        apply_plan(scene, plan)
        output = OutputSettings.of_scene(scene)
        frames = plan.frames or range(scene.frame_start, scene.frame_end + 1, scene.frame_step)
        for number, frame in enumerate(frames, 1):
            interruption.check()
            missing = _missing_files(plan, scene, frame)
            seconds.append(_write_frame(scene, frame, missing, output, interruption) if missing else None)
            on_frame(FrameProgress(frame, number, len(frames), seconds[-1]))
    written = [s for s in seconds if s is not None]
    return SequenceReport(
        plan.folder, len(written), len(seconds) - len(written), statistics.median(written) if written else 0.0
    )


def open_shot(path: Path) -> bpy.types.Scene:
    """Open a .blend file in this process; returns its active scene.

    Raises:
        LiveHandError: there is no such file, or it is no .blend.
    """
    if not path.is_file():
        raise LiveHandError(f"no file at {path}; give the path of a .blend")
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path.resolve()), load_ui=False)
    except RuntimeError as error:
        raise LiveHandError(
            f"{path} must be a .blend file that this Blender can read; {_blender_message(error)}"
        ) from error
    return bpy.context.scene


def apply_plan(scene: bpy.types.Scene, plan: SequencePlan) -> None:
    """Set the engine and the plan's choices in the open scene, in memory only.

    Raises:
        LiveHandError: the scene is stereo.
    """
    render = scene.render
    if render.use_multiview:
        raise LiveHandError(
            "livehand render writes one image per frame, the scene is stereo; turn Stereoscopy off, or render it with "
            "blender -b SHOT.blend -E LIVEHAND -a"
        )
    render.engine = ENGINE
    if plan.size_px:
        render.resolution_x, render.resolution_y = plan.size_px
        render.resolution_percentage = 100
    if plan.device:
        scene.livehand.device = plan.device
    if plan.precision:
        scene.livehand.precision = plan.precision
    if plan.avatar:
        for hand in find_hands(scene):
            hand.livehand.avatar_path = str(plan.avatar.resolve())
    if "exr" in plan.formats:
        for view_layer in scene.view_layers:
            view_layer.use_pass_z = True


def frame_path(plan: SequencePlan, frame: int, file_format: str) -> Path:
    """Where a frame lies: `wave_0001.exr` for frame 1 of `wave.blend`."""
    return plan.folder / f"{plan.shot.stem}_{frame:04d}.{file_format}"


def _missing_files(plan: SequencePlan, scene: bpy.types.Scene, frame: int) -> list[Path]:
    size_px = output_size_px(scene.render)
    paths = [frame_path(plan, frame, file_format) for file_format in plan.formats]
    return [path for path in paths if plan.overwrite or not is_finished(path, size_px)]


def _write_frame(
    scene: bpy.types.Scene, frame: int, paths: Sequence[Path], output: OutputSettings, interruption: _Interruption
) -> float:
    """Render a frame once and save it to every path; returns the seconds it took."""
    start = time.perf_counter()
    with blender_silenced():
        scene.frame_set(frame)
        _render(scene, frame)
        for path in paths:
            interruption.check()
            _save(scene, path, output)
    return time.perf_counter() - start


def _render(scene: bpy.types.Scene, frame: int) -> None:
    try:
        read_camera(scene.camera, scene.render)  # Blender's own message on a missing camera tells no remedy
        result = bpy.ops.render.render(scene=scene.name)
    except (RuntimeError, LiveHandError) as error:
        raise LiveHandError(f"frame {frame}: {_blender_message(error)}") from error
    if "FINISHED" not in result:
        raise LiveHandError(f"frame {frame}: Blender did not render it ({', '.join(result)})")


def _save(scene: bpy.types.Scene, path: Path, output: OutputSettings) -> None:
    """Save Blender's render result so that `path` is either whole or untouched."""
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        output.use(scene, path.suffix[1:])
        bpy.data.images["Render Result"].save_render(str(part.resolve()), scene=scene)
        check_frame(part, output_size_px(scene.render))
        part.replace(path)
    except (RuntimeError, OSError, BrokenFrameError) as error:
        raise LiveHandError(f"{path} could not be written: {_blender_message(error)}; is the disk full?") from error
    finally:
        part.unlink(missing_ok=True)


def _blender_message(error: Exception) -> str:
    """An operator's reports as one line, without Blender's and our own prefixes."""
    lines = [line.removeprefix("Error: ").removeprefix("LiveHand: ").strip() for line in str(error).splitlines()]
    return "; ".join(dict.fromkeys(line for line in lines if line))


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


class _Interruption:
    """Ctrl-C as a flag: an exception inside Blender's render would be swallowed, and the next frame begun.

    A second Ctrl-C raises KeyboardInterrupt at once, wherever Python is.
    """

    def __init__(self):
        self._is_asked = False

    def __enter__(self) -> _Interruption:
        self._previous = signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(self, *_):
        signal.signal(signal.SIGINT, self._previous)

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed."""
        if self._is_asked:
            raise KeyboardInterrupt

    def _ask(self, *_):
        self._is_asked = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
