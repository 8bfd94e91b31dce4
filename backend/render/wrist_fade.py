"""A hand's frame that turns transparent towards the cut end of its arm or wrist, to be set over another arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..geometry.tolerances import NEAR_M
from ..hand.arm_end import distance_from_end_m, opaque_share
from ..hand.model import HandModel
from ..records.depth_profile import DepthProfile
from ..records.frame import DEPTH_BACKGROUND, Frame
from ..records.shot import Shot
from .composition import profile_of
from .surface_maps import vertex_map

_SOLID_ALPHA = 0.5
# Around the end's mesh; the surface lies at most 3 mm above it, and an arm is 5 cm wide.
_MARGIN_PX, _MARGIN_SHARE = 8, 0.15


def faded(frame: Frame, shot: Shot, hand: HandModel) -> Frame:
    """Apply the shot's fade to the frame; without one, the same frame.

    Args:
        frame: of the shot.
        shot: its `wrist_fade_m` is how far along the arm of the hand at rest the frame is not opaque.
        hand: the model, of either side.
    """
    if shot.wrist_fade_m == 0 or not frame.alpha.any():
        return frame
    share = _opaque_share(frame, shot, hand.for_side(shot.pose.side))
    alpha = frame.alpha * share
    depth = np.where(alpha < _SOLID_ALPHA, np.float32(DEPTH_BACKGROUND), frame.depth)
    return replace(
        frame,
        rgb=frame.rgb * share[..., None],
        alpha=alpha,
        depth=depth,
        profile=_faded_profile(profile_of(frame), share),
    )


def _opaque_share(frame: Frame, shot: Shot, model: HandModel) -> np.ndarray:
    """Compute what remains of each pixel of the frame [H, W]; only the window that shows the end is looked at."""
    of_vertices = distance_from_end_m(model)
    of_faces = of_vertices[model.f]
    rows, columns = _window(shot, model.f[of_faces.min(1) < shot.wrist_fade_m])
    size_px = (columns.stop - columns.start, rows.stop - rows.start)
    share = np.ones(frame.alpha.shape, np.float32)
    if min(size_px) <= 0:
        return share
    cropped = shot.with_camera(shot.camera.cropped(columns.start, rows.start, size_px))
    distance_m = _spread(vertex_map(cropped, model, of_vertices), frame.alpha[rows, columns] > 0)
    share[rows, columns] = opaque_share(distance_m, shot.wrist_fade_m)
    return share


def _window(shot: Shot, faces: np.ndarray) -> tuple[slice, slice]:
    """Find rows and columns of the image that show faces [F, 3] and what little of the hand lies beside them."""
    width, height = shot.camera.size_px
    pixels, depth_m = shot.camera.project(shot.vertices[np.unique(faces)])
    if (depth_m <= NEAR_M).any():
        return slice(0, height), slice(0, width)
    low, high = pixels.min(0), pixels.max(0)
    margin = _MARGIN_PX + _MARGIN_SHARE * (high - low).max()
    start = np.floor(np.clip(low - margin, 0, (width, height))).astype(int).tolist()
    stop = np.ceil(np.clip(high + margin, 0, (width, height))).astype(int).tolist()
    return slice(start[1], stop[1]), slice(start[0], stop[0])


def _spread(distance_m: np.ndarray, is_needed: np.ndarray) -> np.ndarray:
    """Fill needed pixels beside the mesh [H, W] with the mean of their known neighbours, outwards pixel by pixel.

    Pixels that are not needed, or that no mesh is near, are infinitely far.
    """
    filled = distance_m.copy()
    while (is_open := np.isnan(filled) & is_needed).any():
        padded = np.pad(filled, 1, constant_values=np.nan)
        height, width = filled.shape
        around = [padded[y : y + height, x : x + width][is_open] for y in range(3) for x in range(3)]
        known = np.isfinite(around)
        if not known.any():
            break
        means = np.where(known, around, 0).sum(0) / np.maximum(known.sum(0), 1)
        filled[is_open] = np.where(known.any(0), means, np.nan)
    return np.nan_to_num(filled, nan=np.inf)


def _faded_profile(profile: DepthProfile, share: np.ndarray) -> DepthProfile:
    """Multiply the opacity of each ray by the mean share [H, W] of its pixels."""
    has_ray, count = profile.row >= 0, len(profile.weights)
    rays = profile.row[has_ray]
    pixels = np.bincount(rays, minlength=count)
    mean = np.bincount(rays, share[has_ray], count) / np.maximum(pixels, 1)
    return replace(profile, weights=profile.weights * mean[:, None].astype(np.float32))
