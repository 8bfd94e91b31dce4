"""A hand's frame that turns transparent towards the cut end of its arm or wrist, to be set over another arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..hand.bones import rest_bones, rest_forearm
from ..hand.model import HandModel
from ..records.depth_profile import DepthProfile, four_depths
from ..records.frame import DEPTH_BACKGROUND, Frame
from ..records.shot import Shot
from .surface_maps import vertex_map

_SOLID_ALPHA = 0.5


def faded(frame: Frame, shot: Shot, hand: HandModel) -> Frame:
    """The frame with the shot's fade; without one, the same frame.

    Args:
        frame: of the shot.
        shot: its `wrist_fade_m` is how far along the arm of the hand at rest the frame is not opaque.
        hand: the model, of either side.
    """
    if shot.wrist_fade_m == 0 or not frame.alpha.any():
        return frame
    distance_m = vertex_map(shot, hand, distance_from_end_m(hand.for_side(shot.pose.side)))
    share = np.clip(_spread(distance_m, frame.alpha > 0) / shot.wrist_fade_m, 0, 1)
    share = (share**2 * (3 - 2 * share)).astype(np.float32)
    alpha = frame.alpha * share
    depth = np.where(alpha < _SOLID_ALPHA, np.float32(DEPTH_BACKGROUND), frame.depth)
    profile = _faded_profile(frame.profile or DepthProfile.of_depth(frame.depth, DEPTH_BACKGROUND), share)
    return replace(frame, rgb=frame.rgb * share[..., None], alpha=alpha, depth=depth, profile=profile)


def distance_from_end_m(model: HandModel) -> np.ndarray:
    """[V] m of the mean shape at rest from the plane across the arm, or the wrist's bone, that its end touches."""
    elbow = -(rest_forearm(model).frame if model.has_arm else rest_bones(model).frames[0])[:, 1]
    along = model.v_template @ elbow
    return along.max() - along


def _spread(distance_m: np.ndarray, is_needed: np.ndarray) -> np.ndarray:
    """[H, W] with the mean of the known neighbours in needed pixels beside the mesh, outwards pixel by pixel."""
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
    return np.nan_to_num(filled, nan=0.0)


def _faded_profile(profile: DepthProfile, share: np.ndarray) -> DepthProfile:
    """The opacity of each ray, times the mean share [H, W] of its 2 x 2 pixels."""
    has_ray = profile.row >= 0
    of_ray = np.ones(len(profile.weights), np.float32)
    of_ray[profile.row[has_ray]] = four_depths(share).mean(-1)[has_ray]
    return replace(profile, weights=profile.weights * of_ray[:, None])
