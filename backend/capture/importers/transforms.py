"""Reads a nerfstudio-style `transforms.json` and a file of poses.

The intrinsics are fl_x, fl_y, cx, cy, w, h (or camera_angle_x), for all images or for each; the camera of each image is
a camera-to-world `transform_matrix` with OpenGL's axes: x right, y up, z backward. Lens distortion is refused. The pose
of an image is given by its `pose_index`, by its `time` if the poses have times, or is the only pose. Its `light`, if it
has one, is an entry of `lights` or the index of one, as a capture's own index has them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import pi, tan
from pathlib import Path
from typing import Any

import numpy as np

from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.shot import HandPose
from ...system.files import inner_path
from ...system.readers import read_json, read_npz
from ..capture import read_all, read_pose
from ..lights import CaptureLight, read_light
from ..picture import read_header, wrong_size

_OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
_PINHOLES = ("PINHOLE", "SIMPLE_PINHOLE", "OPENCV")  # OPENCV without distortion is a pinhole
_SUFFIXES = (".png", ".jpg", ".jpeg", ".exr")
_SAME_TIME = 1e-6


@dataclass(frozen=True)
class PoseTable:
    """Poses, and the time of each if the file has times."""

    poses: tuple[HandPose, ...]
    times: np.ndarray | None


@dataclass(frozen=True)
class TransformsFrame:
    """One image: its file, mask, camera, pose, light (None: not known) and exposure; equal lights are one object."""

    image: Path
    mask: Path | None
    camera: Camera
    pose_index: int
    light: CaptureLight | None = None
    exposure: float = 1.0


def read_pose_table(path: Path, hands_mean: np.ndarray | None = None) -> PoseTable:
    """Read a .npz with theta [P, 16, 3] or [P, 48], transl [P, 3], beta [P, 10] or [10], optional side and time [P].

    `hands_mean` [15, 3] rad is added to the fingers if the poses are relative to it. `side` defaults to right.

    Raises:
        LiveHandError: the file is unreadable or malformed.
    """
    try:
        arrays = read_npz(path)
        theta = np.array(arrays["theta"], float).reshape(-1, 16, 3)
        beta = np.array(np.broadcast_to(arrays["beta"], (len(theta), 10)), float)
        transl = np.array(arrays["transl"], float).reshape(len(theta), 3)
        sides = np.broadcast_to(arrays.get("side", np.array("right")), len(theta))
        times = np.array(arrays["time"], float).reshape(len(theta)) if "time" in arrays else None
    except (LiveHandError, KeyError, ValueError, TypeError) as error:
        raise LiveHandError(f"{path} must hold theta, beta and transl of every pose ({error})") from error
    if hands_mean is not None:
        theta[:, 1:] += hands_mean
    rows = enumerate(zip(theta, beta, transl, sides, strict=True))
    return PoseTable(read_all(path, ((read_pose, index, *row) for index, row in rows)), times)


def read_transforms(
    path: Path, poses: PoseTable, metres_per_unit: float, allows_outside: bool = False
) -> list[TransformsFrame]:
    """Read the images of a `transforms.json`, in its order.

    A unit other than the metre scales cameras, lamps and occluders; lamps keep their irradiance on the hand. Images,
    masks and skies must lie in the folder of the file, links followed, unless `allows_outside`.

    Raises:
        LiveHandError: with the file and its faults.
    """
    try:
        document = read_json(path)
        entries = list(document["frames"])
    except (LiveHandError, KeyError, TypeError) as error:
        raise LiveHandError(f"{path} must hold JSON with a list of frames ({type(error).__name__}: {error})") from error
    frames: list[TransformsFrame] = []
    faults: dict[str, list[str]] = {}  # the frames that have each
    files = _Files(path.parent, allows_outside)
    lights = _FrameLights(files, document.get("lights", []), metres_per_unit)
    for number, entry in enumerate(entries):
        try:
            frame = _read_frame({**document, **entry}, files, poses, metres_per_unit)
            frames.append(replace(frame, light=lights.of(entry.get("light"))))
        except (KeyError, TypeError, ValueError, ZeroDivisionError, OverflowError, LiveHandError) as error:
            name = entry.get("file_path", number) if isinstance(entry, dict) else number
            what = f"{error} is missing" if isinstance(error, KeyError) else error
            faults.setdefault(str(what), []).append(str(name))
    if faults or not frames:
        found = [_fault(what, of_frames) for what, of_frames in faults.items()]
        raise LiveHandError.of_faults(str(path), found or ["frames must not be empty"])
    return frames


def _fault(what: str, frames: list[str]) -> str:
    """Word what is wrong in these frames once."""
    more = f" and {len(frames) - 1} more" if len(frames) > 1 else ""
    return f"frame {frames[0]}{more}: {what}"


def _read_frame(entry: Mapping[str, Any], files: _Files, poses: PoseTable, metres_per_unit: float) -> TransformsFrame:
    """Read an `entry`, which holds the document's values overridden by the frame's."""
    _refuse_distortion(entry)
    image = files.image(entry["file_path"])
    size_px = read_header(image)[1]
    if "w" in entry and "h" in entry and (int(entry["w"]), int(entry["h"])) != size_px:
        raise LiveHandError(f"{image} must be w x h = {entry['w']} x {entry['h']} px, got {size_px}")
    cam2world = np.array(entry["transform_matrix"], float)
    if cam2world.shape == (3, 4):
        cam2world = np.vstack([cam2world, [0.0, 0.0, 0.0, 1.0]])
    if cam2world.shape == (4, 4):
        cam2world = cam2world @ _OPENGL_TO_OPENCV
        cam2world[:3, 3] *= metres_per_unit
    mask = files.mask(entry["mask_path"], size_px) if entry.get("mask_path") is not None else None
    exposure = float(entry.get("exposure", 1.0))
    if not 0 < exposure < np.inf:
        raise LiveHandError(f"exposure must be a finite number above 0, got {exposure}")
    camera = Camera(_intrinsics(entry, size_px), cam2world, size_px)
    return TransformsFrame(image, mask, camera, _pose_of(entry, poses), exposure=exposure)


class _FrameLights:
    """The lights of a document's frames, each read once."""

    def __init__(self, files: _Files, entries: object, metres_per_unit: float):
        self._files, self._entries, self._metres_per_unit = files, entries, metres_per_unit
        self._read: dict[str, CaptureLight] = {}

    def of(self, light: object) -> CaptureLight | None:
        """Read the light of a frame's entry or index, None without one."""
        if light is None:
            return None
        name, entry = "light", light
        if isinstance(light, int) and not isinstance(light, bool):
            if not isinstance(self._entries, list) or not 0 <= light < len(self._entries):
                raise LiveHandError(f"light must be an index of lights, got {light}")
            name, entry = f"lights[{light}]", self._entries[light]
        key = json.dumps(entry, sort_keys=True)
        if key not in self._read:
            if isinstance(entry, dict) and entry.get("sky_path") is not None:
                self._files.path(entry["sky_path"])
            light_in_file = read_light(self._files.folder, name, entry)
            self._read[key] = _in_metres(light_in_file, self._metres_per_unit)
        return self._read[key]


def _in_metres(light: CaptureLight, metres_per_unit: float) -> CaptureLight:
    """Convert the light of a scene to metres; a lamp's power grows with the square of its distance."""
    if metres_per_unit == 1:
        return light
    lamps = tuple(
        replace(
            lamp,
            rgb=lamp.rgb * (1 if lamp.kind == "sun" else metres_per_unit**2),
            position=lamp.position * metres_per_unit,
            radius_m=lamp.radius_m * metres_per_unit,
            size_m=(lamp.size_m[0] * metres_per_unit, lamp.size_m[1] * metres_per_unit),
        )
        for lamp in light.light.lamps
    )
    occluders = light.light.occluders * metres_per_unit
    return replace(light, light=replace(light.light, lamps=lamps, occluders=occluders))


def _refuse_distortion(entry: Mapping[str, Any]) -> None:
    model = str(entry.get("camera_model", "PINHOLE"))
    distortion = {name: entry[name] for name in _DISTORTION if float(entry.get(name, 0))}
    if distortion or model not in _PINHOLES:
        raise LiveHandError(
            f"images must come from a pinhole camera, got {model} {distortion}; "
            "undistort them first (COLMAP's image_undistorter, OpenCV's undistort)"
        )


@dataclass(frozen=True)
class _Files:
    """The files that a document names: in its folder, unless more is allowed."""

    folder: Path
    allows_outside: bool

    def path(self, name: object) -> Path:
        """Resolve a name to a path."""
        if self.allows_outside:
            return self.folder / str(name)
        try:
            return inner_path(self.folder, name, follows_links=True)
        except LiveHandError as error:
            raise LiveHandError(f"{error}; move it there, or pass --allow-outside") from error

    def image(self, name: object) -> Path:
        """Find the file, or the file of this name with an image suffix."""
        path = self.path(name)
        for suffix in ("", *_SUFFIXES):
            place = self.path(f"{name}{suffix}")
            try:
                if place.is_file():
                    return place
            except (OSError, ValueError) as error:
                raise LiveHandError(f"no image at {path} ({error})") from error
        raise LiveHandError(f"no image at {path}")

    def mask(self, name: object, size_px: tuple[int, int]) -> Path:
        """Find the file of a mask, after a look at its header."""
        path = self.path(name)
        size = read_header(path)[1]
        if size != size_px:
            raise LiveHandError(wrong_size(path, size_px, size))
        return path


def _intrinsics(entry: Mapping[str, Any], size_px: tuple[int, int]) -> np.ndarray:
    width, height = size_px
    fl_x = float(entry["fl_x"]) if "fl_x" in entry else _focal_px(float(entry["camera_angle_x"]), width)
    if "fl_y" in entry:
        fl_y = float(entry["fl_y"])
    else:
        fl_y = _focal_px(float(entry["camera_angle_y"]), height) if "camera_angle_y" in entry else fl_x
    cx, cy = float(entry.get("cx", width / 2)), float(entry.get("cy", height / 2))
    return np.array([[fl_x, 0, cx], [0, fl_y, cy], [0, 0, 1.0]])


def _focal_px(angle_rad: float, side_px: int) -> float:
    if not 0 < angle_rad < pi:
        raise LiveHandError(f"a camera's angle must lie between 0 and pi, got {angle_rad}")
    return side_px / 2 / tan(angle_rad / 2)


def _pose_of(entry: Mapping[str, Any], poses: PoseTable) -> int:
    count = len(poses.poses)
    if "pose_index" in entry:
        index = int(entry["pose_index"])
        if not 0 <= index < count:
            raise LiveHandError(f"pose_index must name one of {count} poses, got {index}")
        return index
    if "time" in entry and poses.times is not None:
        nearest = int(np.abs(poses.times - float(entry["time"])).argmin())
        if abs(poses.times[nearest] - float(entry["time"])) > _SAME_TIME:
            raise LiveHandError(f"time must be one of the poses', got {entry['time']}, nearest {poses.times[nearest]}")
        return nearest
    if count == 1:
        return 0
    raise LiveHandError(f"the frame must have a pose_index, or a time like the poses, to choose among {count} poses")
