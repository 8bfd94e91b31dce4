"""Makes masks for the images of a capture that have no alpha, for `livehand mask`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path, PurePosixPath

import numpy as np
from PIL import Image
from tqdm import tqdm

from ...hand.lbs import posed_arrays
from ...hand.model import HandModel
from ...records.errors import LiveHandError
from ...system.files import replacing
from ..capture import Capture, CaptureView, load_capture, save_capture_index
from ..picture import (
    ALPHA_MODES,
    linear_to_srgb,
    read_header,
    read_linear_picture,
    read_mask,
    read_picture,
    srgb_to_linear,
)
from .mask import MaskConfig, grabcut_mask, hand_regions, load_opencv, short_of_arm

FOLDER = "masks"
_WHITE_SHARE, _WHITE, _DARKEST = 98, 0.9, 1e-6  # percentile of a linear image, and the value that it becomes
_KEPT = 64  # sums of lights; images of one pose and camera follow one another


@dataclass(frozen=True)
class MaskedView:
    """A view with its mask, and the mask's intersection over union with the posed mesh."""

    view: CaptureView
    overlap: float


def mask_capture(
    folder: Path, hand: HandModel, config: MaskConfig, given: Path | None = None, redo: bool = False
) -> list[MaskedView]:
    """Write masks and add them to the capture's index; existing masks are kept, so an interrupted run can be resumed.

    Args:
        folder: of the capture.
        hand: the hand model of the capture's poses.
        config: of new masks.
        given: a folder of masks with the images' names to use instead of making masks.
        redo: make masks also for images that have a mask or alpha.

    Raises:
        LiveHandError: with the file and its fault; the index is unchanged.
    """
    load_opencv()
    capture = load_capture(folder)
    if capture.hand_sha256 != hand.sha256:
        raise LiveHandError(f"capture {folder} must be of hand '{hand.name}', got one of another hand; pass its --hand")
    wanted = [view for view in capture.views if redo or _needs_mask(capture, view)]
    names = _mask_names(folder, wanted)
    in_all_lights = lru_cache(_KEPT)(partial(_in_all_lights, capture))
    done = _run_parallel(
        [
            partial(_mask_view, capture, replace(view, mask=names[view.file]), hand, config, given, redo, in_all_lights)
            for view in wanted
        ]
    )
    masked = {view.view.file: view.view for view in done}
    views = tuple(masked.get(view.file, view) for view in capture.views)
    save_capture_index(replace(capture, views=views))
    return done


def _needs_mask(capture: Capture, view: CaptureView) -> bool:
    return view.mask is None and read_header(capture.folder / view.file)[0] not in ALPHA_MODES


def _mask_names(folder: Path, views: Iterable[CaptureView]) -> dict[str, str]:
    """Map each image to its mask, in the same folder structure."""
    image_of: dict[str, str] = {}
    for view in views:
        file = PurePosixPath(view.file)
        if file.is_absolute() or ".." in file.parts:
            raise LiveHandError(f"{folder}: images must lie in the capture's folder to get masks, got {view.file}")
        other = image_of.setdefault(str(FOLDER / file.with_suffix(".png")), view.file)
        if other != view.file:
            raise LiveHandError(f"{folder}: images must differ by more than their suffix, got {other} and {view.file}")
    return {image: mask for mask, image in image_of.items()}


def _mask_view(
    capture: Capture,
    view: CaptureView,
    hand: HandModel,
    config: MaskConfig,
    given: Path | None,
    redo: bool,
    in_all_lights: Callable[[int, int], np.ndarray],
) -> MaskedView:
    assert view.mask is not None
    path = capture.folder / view.mask
    vertices, joints = posed_arrays(hand, capture.poses[view.pose_index])
    faces = hand.f
    if config.ends_at_wrist:
        vertices, faces = short_of_arm(vertices, hand)
    regions = hand_regions(vertices, joints, faces, view.camera, config)
    if path.is_file() and not redo:
        mask = read_mask(path, view.camera.size_px)
    elif given is not None:
        mask = read_mask(_given_mask(given, view), view.camera.size_px)
    else:
        mask = grabcut_mask(_photograph(capture, view, in_all_lights), regions, config).astype(np.uint8) * 255
    _write_mask(mask, path)
    is_hand = mask > 127
    union = (is_hand | regions.silhouette).sum()
    return MaskedView(view, float((is_hand & regions.silhouette).sum() / union) if union else 1.0)


def _photograph(capture: Capture, view: CaptureView, in_all_lights: Callable[[int, int], np.ndarray]) -> np.ndarray:
    """Return [H, W, 3] uint8: the image; of several lights, the picture of all of them."""
    if view.light is None and not view.is_linear:
        return read_picture(capture.folder / view.file, "RGB", view.camera.size_px)[1]
    if view.light is None:
        return _exposed(_linear(capture, view))
    return in_all_lights(view.pose_index, view.camera_index)


def _in_all_lights(capture: Capture, pose_index: int, camera_index: int) -> np.ndarray:
    """Return [H, W, 3] uint8: the sum of all images of a pose and camera in known lights.

    Light groups and photographs of single lamps are dark where their light does not reach.
    """
    instant = (pose_index, camera_index)
    views = [one for one in capture.views if (one.pose_index, one.camera_index) == instant and one.light is not None]
    return _exposed(np.sum([_linear(capture, one) for one in views], 0))


def _exposed(linear: np.ndarray) -> np.ndarray:
    gain = _WHITE / max(float(np.percentile(linear, _WHITE_SHARE)), _DARKEST)
    return (linear_to_srgb(np.clip(linear * gain, 0, 1)) * 255).round().astype(np.uint8)


def _linear(capture: Capture, view: CaptureView) -> np.ndarray:
    """Return [H, W, 3] linear colours of an image without alpha, its exposure divided out."""
    path, size_px = capture.folder / view.file, view.camera.size_px
    if view.is_linear:
        return read_linear_picture(path, size_px, has_mask=True)[..., :3] / view.exposure
    return srgb_to_linear(read_picture(path, "RGB", size_px)[1].astype(np.float32) / 255) / view.exposure


def _given_mask(folder: Path, view: CaptureView) -> Path:
    """Find the mask of an image `images/a/b.jpg`: `a/b.png`, `images/a/b.png`, or the same with the image's suffix."""
    file = PurePosixPath(view.file)
    short = file.relative_to("images") if file.parts[0] == "images" else file
    points = [folder / name for name in (short.with_suffix(".png"), file.with_suffix(".png"), short, file)]
    for place in points:
        if place.is_file():
            return place
    raise LiveHandError(f"{view.file} must have a mask at {points[0]}, got none")


def _write_mask(mask: np.ndarray, path: Path) -> None:
    with replacing(path) as temporary:
        Image.fromarray(mask).save(temporary, "PNG")


def _run_parallel(jobs: list[Callable[[], MaskedView]]) -> list[MaskedView]:
    """Run the jobs and keep their order; the faults of all are raised together."""
    results, faults = [], []
    with ThreadPoolExecutor(os.cpu_count()) as workers:
        futures = [workers.submit(job) for job in jobs]
        for future in tqdm(futures, unit="image", desc="mask"):
            try:
                results.append(future.result())
            except LiveHandError as error:
                faults.append(str(error))
    if faults:
        raise LiveHandError.of_faults("the capture's masks", faults)
    return results
