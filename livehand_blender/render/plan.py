"""The settings of a sequence and of its files, and their application to the opened scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy

from ...backend.batch.content_credentials import SigningKey
from ...backend.batch.frame_selection import ALL, Chunk
from ...backend.records.errors import LiveHandError
from ...backend.system.command import MOST_PIXELS
from ..rig.hand import all_hands
from ..scene.camera import output_size_px
from ..scene.file_paths import operator_path
from ..scene.settings import ENGINE
from .file_outputs import FileOutputs
from .hand_source import set_avatar


@dataclass(frozen=True)
class SequencePlan:
    """What to render. None keeps the setting of the .blend.

    Attributes:
        shot: the .blend; it is not changed.
        folder: of the frames; created if missing.
        frames: frame numbers; None takes the scene's range and step.
        chunk: the part of these frames to render.
        formats: of each frame, `exr` (multilayer) and `png`; all are saved from one render.
        overwrite: also render frames that were finished when the run began.
        is_strict: render nothing if a frame that stays is of another version.
        file_outputs: what becomes of File Output nodes that write outside the folder.
        began_ns: when the run began, by the clock that dates the folder's files; None: when this sequence begins.
        avatar: for every hand of the scene.
        size_px: (width, height) at 100 %.
        device: `auto`, `cpu` or `cuda`.
        precision: `fp32` or `bf16`.
        has_watermark: writes one, even if the scene does not ask for it.
        signing: signs the PNGs; None: nothing is signed.
    """

    shot: Path
    folder: Path
    frames: Sequence[int] | None = None
    chunk: Chunk = ALL
    formats: Sequence[str] = ("exr",)
    overwrite: bool = False
    is_strict: bool = False
    file_outputs: FileOutputs = "keep"
    began_ns: int | None = None
    avatar: Path | None = None
    size_px: tuple[int, int] | None = None
    device: str | None = None
    precision: str | None = None
    has_watermark: bool = False
    signing: SigningKey | None = None

    def frames_of(self, scene: bpy.types.Scene) -> Sequence[int]:
        """List the numbers of the frames to render."""
        return self.chunk.of(self.frames or range(scene.frame_start, scene.frame_end + 1, max(1, scene.frame_step)))


def open_shot(path: Path) -> bpy.types.Scene:
    """Open a .blend file in this process; returns its active scene.

    Raises:
        LiveHandError: there is no such file, or it is not a .blend.
    """
    if not path.is_file():
        raise LiveHandError(f"no file at {path}; give the path of a .blend")
    try:
        bpy.ops.wm.open_mainfile(filepath=operator_path(path.resolve()), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise LiveHandError(
            f"{path} must be a .blend file that this Blender can read; {blender_message(error)}"
        ) from error
    return bpy.context.scene


def apply_plan(scene: bpy.types.Scene, plan: SequencePlan) -> None:
    """Set the engine and the plan's settings in the open scene, in memory only.

    Raises:
        LiveHandError: the scene is stereo, or its frames have too many pixels.
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
    width, height = output_size_px(render)
    if width * height > MOST_PIXELS:
        raise LiveHandError(
            f"a frame must have at most {MOST_PIXELS} pixels, got {width} x {height}; make the scene's resolution "
            "smaller, or give --size"
        )
    if plan.device:
        scene.livehand.device = plan.device
    if plan.precision:
        scene.livehand.precision = plan.precision
    if plan.has_watermark:
        scene.livehand.watermark = True
    if plan.avatar:
        for hand in all_hands(scene):
            set_avatar(hand, plan.avatar)
    if "exr" in plan.formats:
        for view_layer in scene.view_layers:
            view_layer.use_pass_z = True


def blender_message(error: Exception) -> str:
    """Join an operator's reports to one line, without the prefixes of Blender and LiveHand."""
    lines = [line.removeprefix("Error: ").removeprefix("LiveHand: ").strip() for line in str(error).splitlines()]
    return "; ".join(dict.fromkeys(line for line in lines if line))


@dataclass(frozen=True)
class OutputSettings:
    """Bits per channel of each format: the scene's own if the scene is set to that format.

    Attributes:
        exr_depth: `16` (half) or `32`; Depth is always 32.
        png_depth: `8` or `16`.
    """

    exr_depth: str = "16"
    png_depth: str = "8"

    @classmethod
    def of_scene(cls, scene: bpy.types.Scene) -> OutputSettings:
        """Read the settings, before `use` changes them."""
        settings = scene.render.image_settings
        is_exr = settings.file_format in ("OPEN_EXR", "OPEN_EXR_MULTILAYER")
        return cls(
            exr_depth=settings.color_depth if is_exr else cls.exr_depth,
            png_depth=settings.color_depth if settings.file_format == "PNG" else cls.png_depth,
        )

    def use(self, scene: bpy.types.Scene, file_format: str) -> None:
        """Make the scene save `exr` (multilayer: every pass of every view layer) or `png`, both with alpha.

        View transform, look and dither do not change.
        """
        settings = scene.render.image_settings
        is_exr = file_format == "exr"
        if hasattr(settings, "media_type"):  # Blender 5 offers multilayer EXR only after this
            settings.media_type = "MULTI_LAYER_IMAGE" if is_exr else "IMAGE"
        settings.file_format = "OPEN_EXR_MULTILAYER" if is_exr else "PNG"
        settings.color_mode = "RGBA"
        settings.color_depth = self.exr_depth if is_exr else self.png_depth
        if is_exr:
            settings.exr_codec = "ZIP"  # lossless, and the frame check can decompress it


def unreadable_images() -> Iterator[tuple[str, str]]:
    """Yield (name, reason) of each single-file image in the open .blend that is used and cannot be read."""
    for image in bpy.data.images:
        if image.source == "FILE" and image.users and image.packed_file is None:
            path = Path(bpy.path.abspath(image.filepath, library=image.library))
            reason = _fault(path)
            if reason:
                yield image.name, f"{path}: {reason}"


def _fault(path: Path) -> str | None:
    try:
        with path.open("rb") as file:
            return None if file.read(1) else "empty file"
    except OSError as error:
        return error.strerror
