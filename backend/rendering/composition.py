"""Several hands and a scene in one image: occlusion is resolved along every ray, sample by sample.

Each hand is rendered alone. Its light is attenuated by the other hands' samples and by the scene in front of it, and
the results are summed, so that the order of the hands does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from ..records.depth_profile import DepthProfile, four_depths, opacity_before
from ..records.frame import DEPTH_BACKGROUND, Frame


@dataclass(frozen=True)
class SceneLayer:
    """The rendered scene around the hands.

    Attributes:
        rgb: [H, W, 3] scene-linear Rec.709, premultiplied.
        alpha: [H, W].
        depth: [H, W] m along the optical axis; `DEPTH_BACKGROUND` where there is nothing.
    """

    rgb: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray


def visible_parts(frames: Sequence[Frame], scene_depth: np.ndarray | None = None) -> list[Frame]:
    """The frames without the parts that the other hands and the scene occlude.

    Args:
        frames: of one camera, one per hand.
        scene_depth: [H, W] m; None: there is no scene.
    """
    if len(frames) == 1 and scene_depth is None:
        return list(frames)
    profiles = [_profile_of(frame) for frame in frames]
    seen = [_seen_weights(number, profiles) for number in range(len(profiles))]
    shares = [
        _visible_share(profile, weights, frame.alpha.shape, scene_depth)
        for profile, weights, frame in zip(profiles, _balanced(profiles, seen), frames, strict=True)
    ]
    # The blurred shares of two hands may sum to slightly more than 1.
    total = sum((frame.alpha * share for frame, share in zip(frames, shares, strict=True)), np.float32(0))
    excess = np.maximum(total, 1)
    return [_dimmed(frame, share / excess) for frame, share in zip(frames, shares, strict=True)]


def joined(parts: Sequence[Frame]) -> Frame:
    """One frame of all visible parts, with the nearest depth."""
    return Frame(
        rgb=reduce(np.add, (part.rgb for part in parts)),
        alpha=np.minimum(reduce(np.add, (part.alpha for part in parts)), 1),
        depth=reduce(np.minimum, (part.depth for part in parts)),
    )


def over(hands: Frame, scene: SceneLayer) -> Frame:
    """The joined hands over their scene."""
    behind = 1 - hands.alpha
    return Frame(
        rgb=hands.rgb + behind[..., None] * scene.rgb,
        alpha=hands.alpha + behind * scene.alpha,
        depth=np.minimum(hands.depth, scene.depth),
    )


def mean_frame(frames: Sequence[Frame]) -> Frame:
    """The mean over the samples of an exposure; depth is the first frame's, because a mean depth is meaningless."""
    if len(frames) == 1:
        return frames[0]
    rgb, alpha = (np.mean([getattr(frame, name) for frame in frames], axis=0) for name in ("rgb", "alpha"))
    return Frame(rgb, alpha, frames[0].depth)


def _profile_of(frame: Frame) -> DepthProfile:
    return frame.profile or DepthProfile.of_depth(frame.depth, DEPTH_BACKGROUND)


def _seen_weights(number: int, profiles: Sequence[DepthProfile]) -> np.ndarray:
    """[R, N] a hand's weights, attenuated by the other hands."""
    own, others = profiles[number], [*profiles[:number], *profiles[number + 1 :]]
    has_ray = own.row >= 0
    seen = np.zeros_like(own.weights)
    rays = own.row[has_ray]
    passes = (other.transmittance(other.row[has_ray], own.t[rays]) for other in others)
    seen[rays] = reduce(np.multiply, passes, own.weights[rays])
    return seen


def _balanced(profiles: Sequence[DepthProfile], seen: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The same weights, scaled along each ray so that all hands together are as opaque as one behind the other.

    Where hands intersect, the steps are too coarse to tell how much of each is in front.
    """
    clear = reduce(np.multiply, (1 - _on_grid(profile, profile.alpha) for profile in profiles))
    total = reduce(np.add, (_on_grid(one, weights.sum(1)) for one, weights in zip(profiles, seen, strict=True)))
    scale = (1 - clear) / np.maximum(total, _MIN_ALPHA)
    balanced = []
    for profile, weights in zip(profiles, seen, strict=True):
        has_ray = profile.row >= 0
        of_ray = np.ones(len(weights), np.float32)
        of_ray[profile.row[has_ray]] = scale[has_ray]
        balanced.append(weights * of_ray[:, None])
    return balanced


def _on_grid(profile: DepthProfile, values: np.ndarray) -> np.ndarray:
    """[h, w] a value of each ray, zero where there is no ray."""
    grid = np.zeros(profile.row.shape, np.float32)
    has_ray = profile.row >= 0
    grid[has_ray] = values[profile.row[has_ray]]
    return grid


def _visible_share(
    own: DepthProfile, seen: np.ndarray, shape: tuple[int, ...], scene_depth: np.ndarray | None
) -> np.ndarray:
    """[H, W] share of a hand's light that passes the scene; `seen` [R, N] are its weights behind the other hands."""
    height, width = shape
    has_ray = own.row >= 0
    rays = own.row[has_ray]
    if scene_depth is None:
        light = np.repeat(seen[rays].sum(1, keepdims=True), 4, 1)
    else:
        light = opacity_before(four_depths(scene_depth)[has_ray], own.t[rays], own.dt[rays], seen[rays])
    alpha = own.alpha[rays][:, None]
    share, certainty = (np.zeros((*own.row.shape, 4), np.float32) for _ in range(2))
    share[has_ray] = light / np.maximum(alpha, _MIN_ALPHA)
    certainty[has_ray] = alpha
    return _softened(_as_image(share)[:height, :width], _as_image(certainty)[:height, :width])


_MIN_ALPHA = 1e-6


def _softened(share: np.ndarray, certainty: np.ndarray) -> np.ndarray:
    """Shares with soft edges, one pixel wide, extended to the pixels beside the rays, which have a little alpha.

    Cycles' depth has hard edges, one sample per pixel; without blur, the hand would have them too.
    """
    near, weight = _blurred(share * certainty), _blurred(certainty)
    far, far_weight = _blurred(_blurred(near)), _blurred(_blurred(weight))
    soft = np.where(weight > _MIN_ALPHA, near / np.maximum(weight, _MIN_ALPHA), 1)
    spread = far / np.maximum(far_weight, _MIN_ALPHA)
    return np.clip(np.where((weight <= _MIN_ALPHA) & (far_weight > _MIN_ALPHA), spread, soft), 0, 1)


def _blurred(image: np.ndarray) -> np.ndarray:
    """A 3 x 3 binomial filter, the border repeated."""
    padded = np.pad(image, 1, mode="edge")
    rows = padded[:-2] + 2 * padded[1:-1] + padded[2:]
    return (rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:]) / 16


def _dimmed(frame: Frame, share: np.ndarray) -> Frame:
    alpha = frame.alpha * share
    hidden = alpha < _SOLID_ALPHA
    depth = np.where(hidden, np.float32(DEPTH_BACKGROUND), frame.depth)
    return Frame(frame.rgb * share[..., None], alpha, depth, frame.profile)


_SOLID_ALPHA = 0.5


def _as_image(fours: np.ndarray) -> np.ndarray:
    """The inverse of `four_depths`: [h, w, 4] -> [2h, 2w]."""
    height, width, _ = fours.shape
    return fours.reshape(height, width, 2, 2).transpose(0, 2, 1, 3).reshape(2 * height, 2 * width)
