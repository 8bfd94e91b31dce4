"""Reads a folder of pictures that several calibrated cameras took at one instant.

The folder is one of
- a capture (`backend/capture/capture.py`), of which one pose is taken;
- pictures beside a nerfstudio-style `transforms.json`;
- pictures named by whole numbers (`00.png`, or in `img/` or `images/`) beside `cameras.json`, `cameras.npz` or
  `camera/param.npz`, which hold for each picture K:
  - `int_K` [3, 3] or [4, 4]: intrinsics, px, the centre of the first pixel at (0, 0), as OpenCV counts;
  - `ext_K` [3, 4] or [4, 4]: world to camera, m, OpenCV's axes;
  - and, for all together, `up` [3]: the world's direction upwards; (0, -1, 0) without it.
Lens distortion must have been removed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.capture import FORMAT, load_capture
from ...capture.importers.transforms import PoseTable, read_transforms
from ...capture.picture import read_header, read_picture
from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.shot import HandPose
from ...system.files import is_file, is_folder
from ...system.readers import read_json, read_npz

LEAST_VIEWS = 3
"""Of a rig, and of each hand in it: two cameras alone cannot tell which of them is wrong."""
_CAMERA_FILES = ("cameras.json", "cameras.npz", "camera/param.npz")
_PICTURE_FOLDERS = (".", "img", "images")
_SUFFIXES = (".png", ".jpg", ".jpeg")
_UP = (0.0, -1.0, 0.0)
_FARTHEST_M = 50.0  # that cameras of one hand stand apart
_MOST_SKEW_PX = 1.0
_LEAST_LENGTH = 1e-9


@dataclass(frozen=True)
class RigView:
    """What one camera took.

    Attributes:
        name: of the picture's file, for people.
        rgb: [H, W, 3] uint8, sRGB-encoded.
        camera: as the calibration has it; the world is Z up.
        camera_index: the number of the camera in its files.
    """

    name: str
    rgb: np.ndarray = field(repr=False)
    camera: Camera
    camera_index: int


def has_cameras(folder: Path) -> bool:
    """Return whether a folder has pictures' cameras beside them, other than a capture's."""
    return any((folder / name).is_file() for name in _CAMERA_FILES)


def read_rig(folder: Path | str, instant: int = 0) -> tuple[RigView, ...]:
    """Read pictures and cameras, sorted by the camera's number.

    Args:
        folder: in one of the forms above.
        instant: which pose of a capture.

    Raises:
        LiveHandError: the folder has no cameras, or they are malformed or fewer than three; a picture is missing,
            unreadable, or not of 8 bits.
    """
    folder = Path(folder)
    index = folder / "transforms.json"
    if is_file(index):
        views = _transformed_views(folder, index, instant)
    else:
        views = _numbered_views(folder, _camera_file(folder))
    if len(views) < LEAST_VIEWS:
        raise LiveHandError(
            f"{folder} must hold pictures of at least {LEAST_VIEWS} cameras, got {len(views)}; add views"
        )
    _check_metres(folder, [view.camera for view in views])
    return tuple(sorted(views, key=lambda view: view.camera_index))


def _transformed_views(folder: Path, index: Path, instant: int) -> list[RigView]:
    document = read_json(index)
    if isinstance(document, dict) and document.get("format") == FORMAT:
        capture = load_capture(folder)
        if not 0 <= instant < len(capture.poses):
            raise LiveHandError(f"the instant must be one of {len(capture.poses)} poses of {folder}, got {instant}")
        views = [view for view in capture.views if view.pose_index == instant and not view.is_linear]
        return [_view(folder / view.file, view.camera, view.camera_index) for view in views]
    frames = read_transforms(index, PoseTable((HandPose.rest(),), None), metres_per_unit=1.0)
    return [_view(frame.image, frame.camera, number) for number, frame in enumerate(frames)]


def _camera_file(folder: Path) -> Path:
    for name in _CAMERA_FILES:
        if is_file(folder / name):
            return folder / name
    names = ", ".join(("transforms.json", *_CAMERA_FILES))
    raise LiveHandError(
        f"{folder} must hold the cameras of its pictures ({names}), got none of these; calibrate the rig"
    )


def _numbered_views(folder: Path, path: Path) -> list[RigView]:
    arrays: Any = read_json(path) if path.suffix == ".json" else read_npz(path)
    if not isinstance(arrays, Mapping):
        raise LiveHandError(f"{path} must hold int_K and ext_K by name, got a {type(arrays).__name__}")
    numbers = sorted(int(match[1]) for name in arrays if (match := re.fullmatch(r"int_(\d{1,6})", name)))
    pictures, views, faults = _numbered_pictures(folder), [], []
    for number in numbers:
        try:
            if number not in pictures:
                raise LiveHandError(f"must have a picture named {number:02d} (png or jpg), got none")
            size_px = read_header(pictures[number])[1]
            views.append(_view(pictures[number], numbered_camera(arrays, number, size_px), number))
        except LiveHandError as error:
            faults.append(f"camera {number}: {error}")
    if faults:
        raise LiveHandError.of_faults(str(path), faults)
    return views


def _numbered_pictures(folder: Path) -> dict[int, Path]:
    """List the first picture of each number."""
    found: dict[int, Path] = {}
    for place in (folder / name for name in _PICTURE_FOLDERS if is_folder(folder / name)):
        for path in sorted(place.iterdir()):
            if path.suffix.lower() in _SUFFIXES and re.fullmatch(r"\d{1,6}", path.stem, re.ASCII):
                found.setdefault(int(path.stem), path)
    return found


def numbered_camera(arrays: Mapping[str, Any], number: int, size_px: tuple[int, int]) -> Camera:
    """Convert `int_K` and `ext_K` to a camera in a world that is Z up, its pixels' centres at half px.

    Raises:
        LiveHandError: one is missing, of another shape, skewed, or no rigid transform.
    """
    K = _matrix(arrays, f"int_{number}", ((3, 3), (4, 4)))[:3, :3].copy()
    outer = _matrix(arrays, f"ext_{number}", ((3, 4), (4, 4)))
    if abs(K[0, 1]) > _MOST_SKEW_PX:
        raise LiveHandError(f"int_{number} must have no skew, got {K[0, 1]:.3g} px; undistort the pictures")
    K[0, 1] = 0
    K[:2, 2] += 0.5
    u, scale, vt = np.linalg.svd(outer[:3, :3])
    if np.abs(scale - 1).max() > 1e-2 or np.linalg.det(u @ vt) < 0:
        raise LiveHandError(f"ext_{number} must be rigid, got a scaled, sheared or mirrored matrix; calibrate again")
    rotation, upwards = u @ vt, _to_z_up(np.array(arrays.get("up", _UP), float))
    cam2world = np.eye(4)
    cam2world[:3, :3] = upwards @ rotation.T
    cam2world[:3, 3] = -(upwards @ rotation.T @ outer[:3, 3])
    return Camera(K, cam2world, size_px)


def _matrix(arrays: Mapping[str, Any], name: str, shapes: tuple[tuple[int, int], ...]) -> np.ndarray:
    try:
        values = np.array(arrays[name], float)
    except KeyError as error:
        raise LiveHandError(f"must have {name}, got none") from error
    except (TypeError, ValueError) as error:
        raise LiveHandError(f"{name} must be numbers ({error})") from error
    if values.shape not in shapes or not np.isfinite(values).all():
        wanted = " or ".join(str(list(shape)) for shape in shapes)
        raise LiveHandError(f"{name} must be finite and {wanted}, got {list(values.shape)}")
    return values


def _to_z_up(up: np.ndarray) -> np.ndarray:
    """Compute the shortest rotation [3, 3] that turns `up` to +Z."""
    if up.shape != (3,) or not np.isfinite(up).all() or np.linalg.norm(up) < _LEAST_LENGTH:
        raise LiveHandError(f"up must be a direction [3], got {up.tolist()}")
    x, y, z = up / np.linalg.norm(up)
    if z < -1 + _LEAST_LENGTH:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, 0, -x], [0, 0, -y], [x, y, 0]])
    return np.eye(3) + cross + cross @ cross / (1 + z)


def _view(path: Path, camera: Camera, number: int) -> RigView:
    mode, size_px = read_header(path)
    if mode.startswith(("I", "F")):
        raise LiveHandError(f"{path} must be a picture of 8 bits a channel, got mode {mode}; save it as an 8-bit PNG")
    if size_px != camera.size_px:
        raise LiveHandError(f"{path} must be {camera.size_px} px as its camera, got {size_px}")
    return RigView(path.name, read_picture(path, "RGB", camera.size_px)[1], camera, number)


def _check_metres(folder: Path, cameras: list[Camera]) -> None:
    origins = np.stack([camera.origin for camera in cameras])
    apart_m = float(np.median(np.linalg.norm(origins - np.median(origins, 0), axis=1)))
    if not _LEAST_LENGTH < apart_m < _FARTHEST_M:
        raise LiveHandError(
            f"cameras of {folder} must stand around a hand, in metres, got them {apart_m:.3g} m apart; "
            "convert the unit of their translations"
        )
