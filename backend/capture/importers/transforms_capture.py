"""Makes a capture of a nerfstudio-style `transforms.json`, for `livehand import-transforms`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...hand.model import HandModel
from ...records.camera import Camera
from ...records.errors import LiveHandError
from ..capture import Capture, CaptureView
from ..split import split_of
from .staging import check_target, write_capture
from .transforms import PoseTable, TransformsFrame, read_transforms

CAMERA_STEP = 8
"""Every eighth camera is held out."""
LIGHT_STEP = 8
"""Every eighth light is held out."""
POSE_SHARE = 10
"""The last tenth of the poses is held out."""


def import_transforms(
    path: Path,
    poses: PoseTable,
    hand: HandModel,
    output: Path,
    metres_per_unit: float = 1.0,
    held_out_poses: Sequence[int] | None = None,
    held_out_cameras: Sequence[int] | None = None,
    held_out_lights: Sequence[int] | None = None,
    allows_outside: bool = False,
) -> Capture:
    """Write a capture; by default the last tenth of the poses, every eighth camera and every eighth light are held out.

    An image of a held-out light whose pose and camera are trained on is of the split `novel_light`.

    Raises:
        LiveHandError: with the file and its faults; nothing is written.
    """
    check_target(output)
    frames = read_transforms(path, poses, metres_per_unit, allows_outside)
    camera_index = _camera_indices([frame.camera for frame in frames])
    poses_out = _held_out(held_out_poses, len(poses.poses), "poses", _last_tenth(len(poses.poses)))
    cameras = max(camera_index) + 1
    cameras_out = _held_out(held_out_cameras, cameras, "cameras", set(range(CAMERA_STEP - 1, cameras, CAMERA_STEP)))
    lights = list({id(frame.light): frame.light for frame in frames if frame.light is not None}.values())
    light_index = {id(light): index for index, light in enumerate(lights)}
    lights_out = _held_out_lights(held_out_lights, len(lights))
    files: dict[str, Path] = {}
    views = []
    for frame, camera in zip(frames, camera_index, strict=True):
        image, mask = _names(len(views), frame)
        files[image] = frame.image
        if mask is not None and frame.mask is not None:
            files[mask] = frame.mask
        split = split_of(frame.pose_index in poses_out, camera in cameras_out)
        light = None if frame.light is None else light_index[id(frame.light)]
        if split == "train" and light in lights_out:
            split = "novel_light"
        views.append(CaptureView(image, frame.camera, camera, frame.pose_index, split, mask, light, frame.exposure))
    provenance = {"made_by": "livehand import-transforms", "source": path.name}
    capture = Capture(output, hand.sha256, provenance, poses.poses, tuple(views), tuple(lights))
    write_capture(capture, files)
    return capture


def _camera_indices(cameras: list[Camera]) -> list[int]:
    """Find the index of each image's camera; equal cameras are one, numbered by their first images."""
    seen: dict[bytes, int] = {}
    return [seen.setdefault(camera.K.tobytes() + camera.cam2world.tobytes(), len(seen)) for camera in cameras]


def _last_tenth(count: int) -> set[int]:
    return set(range(count - count // POSE_SHARE, count))


def _held_out(chosen: Sequence[int] | None, count: int, what: str, default: set[int]) -> set[int]:
    """Choose the held-out indices: the given ones, or the default."""
    held_out = default if chosen is None else set(chosen)
    if not held_out <= set(range(count)) or len(held_out) == count:
        raise LiveHandError(f"held-out {what} must be some, but not all, of 0 to {count - 1}, got {sorted(held_out)}")
    return held_out


def _held_out_lights(chosen: Sequence[int] | None, count: int) -> set[int]:
    if not count and not chosen:
        return set()
    return _held_out(chosen, count, "lights", set(range(LIGHT_STEP - 1, count, LIGHT_STEP)))


def _names(number: int, frame: TransformsFrame) -> tuple[str, str | None]:
    """Name the image and its mask in the capture by number, because files in several folders may share names."""
    image = f"images/{number:06d}_{frame.image.name}"
    return image, None if frame.mask is None else f"masks/{number:06d}_{frame.mask.name}"
