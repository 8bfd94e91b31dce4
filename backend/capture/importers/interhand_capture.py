"""Makes a capture of InterHand2.6M, for `livehand import-interhand`."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ...hand.model import HandModel
from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.shot import HandPose
from ..capture import Capture, CaptureView
from ..picture import read_header
from ..split import HELD_OUT_FRAMES, FrameSplit, default_split, every, load_split, split_document
from .interhand import (
    DataSplit,
    InterHandImage,
    annotation_file,
    camera_of_image,
    read_cameras,
    read_images,
    read_poses,
)
from .staging import check_target, write_capture

Shape = Literal["per-frame", "mean", "median"]

_READERS = 8  # threads that read image headers, which mostly wait for the disk


@dataclass(frozen=True)
class InterHandRequest:
    """The part of InterHand2.6M to import.

    Attributes:
        root: the folder that contains `images`.
        annotations: the folder of the annotations.
        split: of the data set.
        capture: number of the capture.
        sequences: names of the sequences; None: all.
        cameras: ids of the cameras; None: all colour cameras.
        shape: each frame's own shape, or the mean or median shape for all frames.
        split_file: a file of held-out frames and cameras; None: `held_out_frames` and `held_out_cameras` apply.
        held_out_frames: number of frames held out at the end.
        held_out_cameras: ids of held-out cameras; None: every tenth.
        every: import only each n-th frame.
    """

    root: Path
    annotations: Path
    split: DataSplit
    capture: int
    sequences: Sequence[str] | None = None
    cameras: Sequence[str] | None = None
    shape: Shape = "per-frame"
    split_file: Path | None = None
    held_out_frames: int = HELD_OUT_FRAMES
    held_out_cameras: Sequence[str] | None = None
    every: int = 1

    @property
    def source(self) -> str:
        """The source as named in split files."""
        return f"InterHand2.6M {self.split}/Capture{self.capture} right"


@dataclass(frozen=True)
class InterHandResult:
    """The capture, and how many images of grey cameras and frames without a fit were skipped."""

    capture: Capture
    grey_images: int
    unfitted_frames: int


def import_interhand(
    request: InterHandRequest, hand: HandModel, hands_mean: np.ndarray, output: Path
) -> InterHandResult:
    """Write a capture of one subject's right hand; hands_mean [15, 3] rad is that of the hand model.

    Raises:
        LiveHandError: with the file and its faults; nothing is written.
    """
    check_target(output)
    images, grey, calibrations, fits = _read(request, hands_mean)
    images = [image for image in images if _is_requested(image, request)]
    fitted = [image for image in images if image.frame in fits]
    split = _split(request, fitted)
    used = _used(fitted, split)
    cameras = _cameras(request, used, calibrations)
    poses = _poses(fits, split.frames, request.shape, hand)
    views = _views(used, cameras, split)
    provenance = {"made_by": "livehand import-interhand", "source": split.source, "shape": request.shape}
    capture = Capture(output, hand.sha256, provenance, poses, views)
    files = {view.file: _file(request, image) for view, image in zip(views, used, strict=True)}
    write_capture(capture, files, {"split.json": split_document(split)})
    unfitted = {image.frame for image in images} - {image.frame for image in fitted}
    return InterHandResult(capture, grey, len(unfitted))


def _read(
    request: InterHandRequest, hands_mean: np.ndarray
) -> tuple[list[InterHandImage], int, dict[str, tuple[np.ndarray, np.ndarray]], dict[int, HandPose]]:
    """Read images, number of grey images, calibrations and fits; small files come first to report faults early."""
    data, camera, mano = (
        annotation_file(request.annotations, request.split, name) for name in ("data", "camera", "MANO_NeuralAnnot")
    )
    calibrations, fits = read_cameras(camera, request.capture), read_poses(mano, request.capture, hands_mean)
    return *read_images(data, request.capture), calibrations, fits


def _is_requested(image: InterHandImage, request: InterHandRequest) -> bool:
    is_sequence = request.sequences is None or image.sequence in request.sequences
    return is_sequence and (request.cameras is None or image.camera in request.cameras)


def _split(request: InterHandRequest, images: list[InterHandImage]) -> FrameSplit:
    frames, cameras = {image.frame for image in images}, {image.camera for image in images}
    if not images:
        raise LiveHandError(
            f"{request.source} must have images of the requested sequences and cameras in frames with a fit, got none"
        )
    if request.split_file is None:
        held_out = None if request.held_out_cameras is None else list(request.held_out_cameras)
        split = default_split(request.source, list(frames), list(cameras), request.held_out_frames, held_out)
        return every(split, request.every)
    split = load_split(request.split_file, request.source)
    missing = [*sorted(set(split.cameras) - cameras), *sorted(set(split.frames) - frames)]
    if missing:
        raise LiveHandError(
            f"{request.split_file} must name frames and cameras that {request.source} has and that are requested, "
            f"got {len(missing)} others, such as {missing[:5]}"
        )
    return every(split, request.every)


def _cameras(
    request: InterHandRequest, images: list[InterHandImage], calibrations: dict[str, tuple[np.ndarray, np.ndarray]]
) -> list[Camera]:
    """Give each image its camera, with the size of its file."""

    def camera_of(image: InterHandImage) -> Camera | str:
        path = _file(request, image)
        try:
            mode, size_px = read_header(path)
            if mode != "RGB":
                return f"{path} must be a colour image (RGB), got mode {mode}"
            if image.camera not in calibrations:
                return f"{path}: camera {image.camera} must be calibrated, got no such camera"
            return camera_of_image(*calibrations[image.camera], size_px)
        except LiveHandError as error:
            return str(error) if str(path) in str(error) else f"{path}: {error}"

    with ThreadPoolExecutor(_READERS) as readers:
        found = list(readers.map(camera_of, images))
    faults = [camera for camera in found if isinstance(camera, str)]
    if faults:
        raise LiveHandError.of_faults(str(request.root), faults)
    return [camera for camera in found if isinstance(camera, Camera)]


def _poses(fits: dict[int, HandPose], frames: tuple[int, ...], shape: Shape, hand: HandModel) -> tuple[HandPose, ...]:
    poses = [fits[frame] for frame in frames]
    if shape == "per-frame":
        return tuple(poses)
    middle = np.mean if shape == "mean" else np.median
    beta = middle([pose.beta for pose in poses], axis=0)
    return tuple(with_shape(pose, beta, hand) for pose in poses)


def with_shape(pose: HandPose, beta: np.ndarray, hand: HandModel) -> HandPose:
    """Replace the pose's shape by another [10], and correct its translation so that the wrist stays in place."""
    wrist_of_beta = np.einsum("v,vck->ck", hand.J_regressor[0], hand.shapedirs)  # [3, 10] m
    return replace(pose, beta=beta, transl=pose.transl + wrist_of_beta @ (pose.beta - beta))


def _used(images: list[InterHandImage], split: FrameSplit) -> list[InterHandImage]:
    frames, cameras = set(split.frames), set(split.cameras)
    return [image for image in images if image.frame in frames and image.camera in cameras]


def _views(images: list[InterHandImage], cameras: list[Camera], split: FrameSplit) -> tuple[CaptureView, ...]:
    pose_index = {frame: index for index, frame in enumerate(split.frames)}
    camera_index = {name: index for index, name in enumerate(split.cameras)}
    return tuple(
        CaptureView(
            file=f"images/{image.file}",
            camera=camera,
            camera_index=camera_index[image.camera],
            pose_index=pose_index[image.frame],
            split=split.of(image.frame, image.camera),
        )
        for image, camera in zip(images, cameras, strict=True)
    )


def _file(request: InterHandRequest, image: InterHandImage) -> Path:
    return request.root / "images" / request.split / image.file
