"""Checks that a capture can be trained on, so that its faults appear in the first minute instead of after hours.

`load_capture` checks the index and the poses by themselves; this module checks them against the hand and the images.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ..geometry.tolerances import NEAR_M
from ..hand.lbs import posed_vertices
from ..hand.model import HandModel
from ..records.camera import Camera
from ..records.errors import LiveHandError
from .capture import Capture, CaptureView
from .picture import ALPHA_MODES, no_alpha, read_header, wrong_size

# A hand counts as visible if this share of its vertices projects into the image; fewer may all be hidden or cut off.
_SHARE_IN_IMAGE = 0.1
_HAND_ALPHA = 0.5


def check_capture(capture: Capture, hand: HandModel, decode: bool = True) -> None:
    """Check everything that training reads: index, poses, every image's header and, with `decode`, its pixels.

    Poses and headers take 0.3 ms per image, decoding 4 ms of one core at 334x512, on all cores at once.

    Raises:
        LiveHandError: with the first ten faults, each with its file, and their count.
    """
    faults = [*_index_faults(capture, hand), *_pose_faults(capture, hand)]
    faults += [fault for view in capture.views for fault in _camera_faults(view)]
    if not faults:
        faults = _image_faults(capture, hand, decode)
    if faults:
        raise LiveHandError.of_faults(f"capture {capture.folder}", faults)


def _index_faults(capture: Capture, hand: HandModel) -> Iterable[str]:
    if capture.hand_sha256 != hand.sha256:
        yield f"it must be of hand '{hand.name}', got one of hand {capture.hand_sha256[:12]}...; pass its --hand"
    if not capture.views:
        yield "it must have images, got none"
    for file, count in Counter(view.file for view in capture.views).items():
        if count > 1:
            yield f"{file} must be named once, got {count} times"
    shown = Counter((view.camera_index, view.pose_index, view.light) for view in capture.views)
    for (camera, pose, light), count in shown.items():
        if count > 1:
            of_light = "" if light is None else f" in light {light}"
            yield f"camera {camera} must have one image of pose {pose}{of_light}, got {count}"


def _pose_faults(capture: Capture, hand: HandModel) -> Iterable[str]:
    for index in sorted({view.pose_index for view in capture.views}):
        side = capture.poses[index].side
        if side != hand.side:
            yield f"poses.npz: pose {index} must be of the {hand.side} hand, got a {side} one"


def _camera_faults(view: CaptureView) -> Iterable[str]:
    K, last_row = view.camera.K, view.camera.cam2world[3]
    if K[0, 0] <= 0 or K[1, 1] <= 0 or K[1, 0] != 0 or (K[2] != (0, 0, 1)).any():
        yield f"{view.file}: K must be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] px, fx and fy above 0, got {K.tolist()}"
    if (last_row != (0, 0, 0, 1)).any():
        yield f"{view.file}: the last row of cam2world must be 0 0 0 1, got {last_row.tolist()}; is it transposed?"


def _image_faults(capture: Capture, hand: HandModel, decode: bool) -> list[str]:
    posed = {index: posed_vertices(hand, capture.poses[index]) for index in {view.pose_index for view in capture.views}}
    boxes = [hand_box(posed[view.pose_index], view.camera) for view in capture.views]
    if all(box is None for box in boxes):
        return ["no camera sees the hand; cam2world must have OpenCV's axes (x right, y down, z forward) and metres"]
    with ThreadPoolExecutor(os.cpu_count()) as workers:
        found = list(workers.map(lambda view: _header_fault(capture, view), capture.views))
        if decode and not any(found):
            found = list(workers.map(lambda view, box: _pixel_fault(capture, view, box), capture.views, boxes))
    return [fault for fault in found if fault]


def hand_box(vertices: np.ndarray, camera: Camera) -> np.ndarray | None:
    """Find [2, 2] the smallest and largest (x, y) px of the hand in the image; None if too little of it is there."""
    positions_px, depth = camera.project(vertices)
    is_inside = (depth > NEAR_M) & (positions_px >= 0).all(1) & (positions_px < camera.size_px).all(1)
    if is_inside.mean() < _SHARE_IN_IMAGE:
        return None
    return np.stack([positions_px[is_inside].min(0), positions_px[is_inside].max(0)])


def _header_fault(capture: Capture, view: CaptureView) -> str | None:
    """Find the fault in the headers of the image and its mask, if any."""
    try:
        for file in (view.file, view.mask):
            if file is None:
                continue
            mode, size = read_header(capture.folder / file)
            if size != tuple(view.camera.size_px):
                return wrong_size(capture.folder / file, view.camera.size_px, size)
            if view.mask is None and mode not in ALPHA_MODES:
                return no_alpha(capture.folder / file, mode)
    except LiveHandError as error:
        return str(error)
    return None


def _pixel_fault(capture: Capture, view: CaptureView, box: np.ndarray | None) -> str | None:
    """Find the fault in the pixels, if any: unreadable, or with alpha where the hand is not."""
    try:
        is_hand = _alpha(capture, view) >= _HAND_ALPHA
    except LiveHandError as error:
        return str(error)
    if box is None:
        return None
    file = view.mask or view.file
    if not is_hand.any():
        return f"{file} must show the hand, which its pose and camera put in the image, got alpha 0 everywhere"
    rows, columns = np.nonzero(is_hand)
    first, last = np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()]) + 1
    if (first > box[1]).any() or (last < box[0]).any():
        return (
            f"{file} must show the hand where its pose and camera put it, {_px(box)} px, got {_px((first, last))} px; "
            "is it the pose of another frame, or is cam2world not in OpenCV's axes?"
        )
    return None


def _alpha(capture: Capture, view: CaptureView) -> np.ndarray:
    """Read the alpha [H, W] in [0, 1]; image and mask are both read."""
    return capture.read_linear(view)[..., 3] if view.is_linear else capture.read_pixels(view)[..., 3] / 255


def _px(box: Iterable[np.ndarray]) -> str:
    return " to ".join(str(tuple(corner.round().astype(int).tolist())) for corner in box)
