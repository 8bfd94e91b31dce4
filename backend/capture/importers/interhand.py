"""Reads InterHand2.6M: right-hand images, cameras and NeuralAnnot's MANO fits.

A capture of the data set is one subject in one of its splits. Its files are `InterHand2.6M_{split}_data.json`,
`..._camera.json` and `..._MANO_NeuralAnnot.json`. Its conventions: cameras in millimetres, MANO fits in metres;
x_cam = camrot (X - campos) with OpenCV's axes, u = focal x / z + princpt, no distortion; poses are relative to MANO's
mean pose (`flat_hand_mean=False`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np

from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.shot import HandPose
from ...records.side import Side
from .json_stream import list_entries, member

DataSplit = Literal["train", "val", "test"]
File = Literal["data", "camera", "MANO_NeuralAnnot"]

_GREY_CAMERAS = "41"  # first digits of the ids of cameras without colour
# Largest distance of the principal point from the image's centre, as a share of the side.
_OFF_CENTRE = 0.2


@dataclass(frozen=True)
class InterHandImage:
    """One image of a single right hand; `file` is relative to the image folder of the split."""

    file: str
    camera: str
    frame: int
    sequence: str


def annotation_file(folder: Path, split: DataSplit, name: File) -> Path:
    """Find the path of an annotation file, in the data set's current layout or its older ones.

    Raises:
        LiveHandError: there is none.
    """
    file = f"InterHand2.6M_{split}_{name}.json"
    points = [folder / file, folder / split / file, folder / "all" / split / file]
    for place in points:
        if place.is_file():
            return place
    raise LiveHandError(f"no {file} in {folder}, {split} or all/{split} in it; pass the folder of the annotations")


def read_images(path: Path, capture: int) -> tuple[list[InterHandImage], int]:
    """Read the capture's images of a single right hand, ordered by frame and camera, and count the skipped grey images.

    Raises:
        LiveHandError: the file is malformed or has no such images.
    """
    entries, right = {}, set()
    for key, entry in list_entries(path, ("images", "annotations")):
        try:
            if key == "annotations":
                if entry["hand_type"] == "right" and np.all(entry["hand_type_valid"]):
                    right.add(entry["image_id"])
            elif int(entry["capture"]) == capture:
                entries[entry["id"]] = _read_image(entry)
        except (KeyError, TypeError, ValueError, LiveHandError) as error:
            raise LiveHandError(
                f"{path}: an entry of {key} is malformed ({type(error).__name__}: {error}): {str(entry)[:80]}"
            ) from error
    images = [image for key, image in entries.items() if key in right]
    coloured = [image for image in images if not image.camera.startswith(_GREY_CAMERAS)]
    if not coloured:
        raise LiveHandError(
            f"{path} must have colour images of a single right hand in capture {capture}, got none "
            f"of the capture's {len(entries)} images"
        )
    return sorted(coloured, key=lambda image: (image.frame, image.camera)), len(images) - len(coloured)


def _read_image(entry: Mapping[str, Any]) -> InterHandImage:
    file = PurePosixPath(entry["file_name"])
    if file.is_absolute() or ".." in file.parts:
        raise LiveHandError(f"file_name must lie inside the data set, got {file}")
    camera = str(entry["camera"])
    return InterHandImage(str(file), camera.removeprefix("cam"), int(entry["frame_idx"]), str(entry["seq_name"]))


def read_cameras(path: Path, capture: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Read K [3, 3] px and cam2world [4, 4] m of every camera of the capture, by camera id.

    Raises:
        LiveHandError: the file is malformed.
    """
    entry = member(path, str(capture))
    try:
        return {str(name): _read_camera(entry, name) for name in entry["campos"]}
    except (KeyError, TypeError, ValueError) as error:
        raise LiveHandError(
            f"{path}: capture {capture} must hold campos, camrot, focal and princpt of every camera, "
            f"got {type(error).__name__}: {error}"
        ) from error


def _read_camera(entry: Mapping[str, Any], name: str) -> tuple[np.ndarray, np.ndarray]:
    shapes = {"campos": (3,), "camrot": (3, 3), "focal": (2,), "princpt": (2,)}
    arrays = {key: np.array(entry[key][name], float).reshape(shape) for key, shape in shapes.items()}
    K, cam2world = np.eye(3), np.eye(4)
    K[[0, 1], [0, 1]], K[:2, 2] = arrays["focal"], arrays["princpt"]
    cam2world[:3, :3], cam2world[:3, 3] = arrays["camrot"].T, arrays["campos"] / 1000
    return K, cam2world


def camera_of_image(K: np.ndarray, cam2world: np.ndarray, size_px: tuple[int, int]) -> Camera:
    """Build the camera of an image of `size_px`.

    The images of camera 400412 were resized with width and height swapped. Its principal point is central only in the
    image with swapped sides, and K is scaled like the pixels.

    Raises:
        LiveHandError: the principal point is far from the centre either way, or the matrices are invalid.
    """
    width, height = size_px
    if _is_central(K, (width, height)):
        return Camera(K, cam2world, size_px)
    if _is_central(K, (height, width)):
        return Camera(np.diag([width / height, height / width, 1.0]) @ K, cam2world, size_px)
    raise LiveHandError(
        f"the principal point must lie near the centre of the image, {size_px} px, got {K[:2, 2].tolist()} px"
    )


def _is_central(K: np.ndarray, size_px: tuple[int, int]) -> bool:
    side = np.array(size_px)
    return bool((np.abs(K[:2, 2] - side / 2) < _OFF_CENTRE * side).all())


@dataclass(frozen=True)
class NeuralAnnotFit:
    """A fit as in the file: pose [48] rad relative to MANO's mean pose, shape [10], trans [3] m."""

    pose: np.ndarray
    shape: np.ndarray
    trans: np.ndarray


def read_poses(path: Path, capture: int, hands_mean: np.ndarray) -> dict[int, HandPose]:
    """Read the right hand's pose in every frame with a fit; `hands_mean` [15, 3] rad is added.

    Raises:
        LiveHandError: the file is malformed.
    """
    poses = {}
    for frame, fit in read_fits(path, capture, "right").items():
        if fit is not None:
            theta = fit.pose.reshape(16, 3).copy()
            theta[1:] += hands_mean
            poses[frame] = HandPose(theta, fit.shape, fit.trans)
    return poses


def read_fits(path: Path, capture: int, side: Side) -> dict[int, NeuralAnnotFit | None]:
    """Read the fit of one hand in every frame, None where it has none.

    Raises:
        LiveHandError: the file is malformed.
    """
    frames = member(path, str(capture))
    try:
        entries = {int(frame): hands[side] for frame, hands in frames.items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise LiveHandError(
            f"{path}: capture {capture} must hold {{frame: {{right, left}}}}, got {type(error).__name__}: {error}"
        ) from error
    fits, faults = {}, []
    for frame, entry in entries.items():
        try:
            fits[frame] = None if entry is None else _read_fit(entry)
        except (KeyError, TypeError, ValueError, LiveHandError) as error:
            faults.append(f"capture {capture}, frame {frame}: {error}")
    if faults:
        raise LiveHandError.of_faults(str(path), faults)
    return fits


def _read_fit(entry: Mapping[str, Any]) -> NeuralAnnotFit:
    pose = HandPose(
        np.array(entry["pose"], float).reshape(16, 3),
        np.array(entry["shape"], float),
        np.array(entry["trans"], float).reshape(3),
    )
    return NeuralAnnotFit(pose.theta.reshape(48), pose.beta, pose.transl)
