"""A folder of several calibrated cameras' pictures of one instant, as pictured hands.

What one hand hides of the other is unknown in the other's pictures. Pictures are cropped to the hand; those of a left
hand are mirrored, with their cameras and the world, in the plane x = 0.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from ...hand.model import HandModel
from ...hand.model_file import load_default_hand
from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.hand_picture import HAND, HandPicture, PicturedHand
from ...records.side import Side
from ...tracking.weights import TrackerNetworks, load_networks
from .calibration import LEAST_VIEWS, RigView, read_rig
from .rig_fit import FittedRig, Say, fitted_rig
from .view_masks import LABEL_OF, hand_labels

_MARGIN_PX = 16
_LEAST_MM2 = 2000.0  # of skin that a view must show
_MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


def pictures_of_rig(
    folder: Path | str,
    held_out: Collection[int] = (),
    instant: int = 0,
    networks: TrackerNetworks | None = None,
    model: HandModel | None = None,
    say: Say = lambda _: None,
) -> dict[Side, PicturedHand]:
    """Read, find and fit the hands of a rig; nothing is written.

    Args:
        folder: as `read_rig` takes it.
        held_out: numbers of cameras that move no hand, to measure by. Their own rotations are fitted to their outlines
            and landmarks afterwards, the hands resting.
        instant: which pose of a capture.
        networks: of the tracker; None: the user's.
        model: any hand in MANO's format; None: the one that ships.
        say: is told what each stage found.

    Raises:
        LiveHandError: the folder is not a rig's, the tracker has not been fetched, a camera to hold out is none of the
            rig's, or no hand is seen by three cameras or more that agree.
    """
    views = read_rig(folder, instant)
    rows = _rows(views, held_out)
    fitted = fitted_rig(views, networks or load_networks(), model or load_default_hand(), rows, say)
    return pictured_hands(views, fitted, rows, Path(folder).name)


def pictured_hands(
    views: Sequence[RigView], fitted: FittedRig, held_out: Collection[int], source: str
) -> dict[Side, PicturedHand]:
    """Cut each hand's pictures out of the views that show enough of it.

    Args:
        views: of the rig.
        fitted: to them.
        held_out: rows of views.
        source: of the pictures, for provenance.

    Raises:
        LiveHandError: no hand is shown by three views or more.
    """
    hands: dict[Side, PicturedHand] = {}
    for side in fitted.poses:
        found = [_picture(view, row, side, fitted, row in held_out) for row, view in enumerate(views)]
        pictures = tuple(picture for picture in found if picture is not None)
        if sum(not picture.is_held_out for picture in pictures) >= LEAST_VIEWS:
            hands[side] = PicturedHand(pictures, side, source, fitted.offset_m[side], is_calibrated=True)
    if not hands:
        raise LiveHandError(
            f"a hand must be shown free by at least {LEAST_VIEWS} cameras, got fewer; turn or free it, or add cameras"
        )
    return hands


def mirrored_camera(camera: Camera) -> Camera:
    """Mirror a camera with its world in the plane x = 0, and its picture left to right."""
    K = camera.K.copy()
    K[0, 2] = camera.size_px[0] - K[0, 2]
    return Camera(K, _MIRROR @ camera.cam2world @ _MIRROR, camera.size_px)


def _rows(views: Sequence[RigView], numbers: Collection[int]) -> list[int]:
    names = [view.camera_index for view in views]
    if missing := sorted(set(numbers) - set(names)):
        raise LiveHandError(f"cameras to hold out must be among {names}, got {missing}")
    return [row for row, name in enumerate(names) if name in numbers]


def _picture(view: RigView, row: int, side: Side, fitted: FittedRig, is_held_out: bool) -> HandPicture | None:
    """Cut out one view's picture of a hand; None: it shows too little of it."""
    scale, mesh = fitted.px_per_mm[row], fitted.meshes[row]
    labels = hand_labels(fitted.labels[row], side, mesh, scale)
    if (labels == HAND).sum() < _LEAST_MM2 * scale**2:
        return None
    rows, columns, camera = _cropped((labels == HAND) | (mesh == LABEL_OF[side]), fitted.cameras[row])
    rgb, labels, pose = view.rgb[rows, columns], labels[rows, columns], fitted.poses[side]
    if side == "left":
        rgb, labels, camera, pose = rgb[:, ::-1], labels[:, ::-1], mirrored_camera(camera), pose.mirrored()
    arrays = np.ascontiguousarray(rgb), np.ascontiguousarray(labels)
    return HandPicture(view.name, *arrays, camera, pose, view.camera_index, is_held_out=is_held_out, moment=0)


def _cropped(region: np.ndarray, camera: Camera) -> tuple[slice, slice, Camera]:
    """Cut the box of a region with a margin, its sides even."""
    spans = []
    for axis, length in ((1, region.shape[0]), (0, region.shape[1])):
        at = np.flatnonzero(region.any(axis))
        first, last = max(0, int(at[0]) - _MARGIN_PX), min(length, int(at[-1]) + 1 + _MARGIN_PX)
        spans.append(slice(first, last - (last - first) % 2))
    rows, columns = spans
    size_px = columns.stop - columns.start, rows.stop - rows.start
    return rows, columns, camera.cropped(columns.start, rows.start, size_px)
