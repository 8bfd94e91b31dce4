"""Several hands and a scene in one image: occlusion is resolved in every pixel, sample by sample along its ray.

Each hand is rendered alone. Its light is attenuated by the other hands' samples and by the scene in front of it, and
the results are summed, so that the order of the hands does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from ..records.depth_profile import DepthProfile, opacity_before
from ..records.frame import DEPTH_BACKGROUND, Frame

_SOLID_ALPHA = 0.5


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
    """Return the frames without the parts that the other hands and the scene occlude.

    Args:
        frames: of one camera, one per hand.
        scene_depth: [H, W] m; None: there is no scene.
    """
    if len(frames) == 1 and scene_depth is None:
        return list(frames)
    profiles = [profile_of(frame) for frame in frames]
    seen = _balanced(profiles, [_visible_weights(number, profiles) for number in range(len(profiles))])
    shares = [_share_before_hands(*hand, profiles) for hand in zip(profiles, seen, strict=True)]
    if scene_depth is not None:
        before_scene = [_share_before_scene(*hand, scene_depth) for hand in zip(profiles, seen, strict=True)]
        shares = [one * other for one, other in zip(shares, before_scene, strict=True)]
    # The blurred shares of two hands may sum to slightly more than 1.
    total = sum((frame.alpha * share for frame, share in zip(frames, shares, strict=True)), np.float32(0))
    excess = np.maximum(total, 1)
    return [_dimmed(frame, share / excess) for frame, share in zip(frames, shares, strict=True)]


def joined(parts: Sequence[Frame]) -> Frame:
    """Join all visible parts into one frame, with the nearest depth."""
    return Frame(
        rgb=reduce(np.add, (part.rgb for part in parts)),
        alpha=np.minimum(reduce(np.add, (part.alpha for part in parts)), 1),
        depth=reduce(np.minimum, (part.depth for part in parts)),
    )


def over(hands: Frame, scene: SceneLayer, hole: np.ndarray) -> Frame:
    """Composite the joined hands over their scene; `hole` [H, W] is the share of each pixel that shows neither."""
    behind = np.maximum(1 - hands.alpha - hole, 0)
    return Frame(
        rgb=hands.rgb + behind[..., None] * scene.rgb,
        alpha=hands.alpha + behind * scene.alpha,
        depth=np.minimum(hands.depth, np.where(hole < _SOLID_ALPHA, scene.depth, np.float32(DEPTH_BACKGROUND))),
    )


def mean_frame(frames: Sequence[Frame]) -> Frame:
    """Average the samples of an exposure; depth is the first frame's, because a mean depth is meaningless."""
    if len(frames) == 1:
        return frames[0]
    rgb, alpha = (np.mean([getattr(frame, name) for frame in frames], axis=0) for name in ("rgb", "alpha"))
    return Frame(rgb, alpha, frames[0].depth)


def profile_of(frame: Frame) -> DepthProfile:
    """Return the frame's own depth profile, or that of a surface which is as deep and as opaque as it."""
    return frame.profile or DepthProfile.of_surface(frame.depth, frame.alpha, DEPTH_BACKGROUND)


def _visible_weights(number: int, profiles: Sequence[DepthProfile]) -> np.ndarray:
    """Attenuate a hand's weights [K, N] in the K pixels that it has rays through by the other hands."""
    own, others = profiles[number], [*profiles[:number], *profiles[number + 1 :]]
    has_ray = own.row >= 0
    rays = own.row[has_ray]
    passes = (other.transmittance(other.row[has_ray], own.t[rays]) for other in others)
    return reduce(np.multiply, passes, own.weights[rays])


def _balanced(profiles: Sequence[DepthProfile], seen: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Scale the weights in each pixel so that all hands together are as opaque as one behind the other.

    Where hands intersect, the steps are too coarse to resolve how much of each is in front.
    """
    clear = reduce(np.multiply, (1 - _on_image(one, _alpha_at_pixels(one)) for one in profiles))
    total = reduce(np.add, (_on_image(one, weights.sum(1)) for one, weights in zip(profiles, seen, strict=True)))
    scale = (1 - clear) / np.maximum(total, _MIN_ALPHA)
    return [weights * scale[one.row >= 0][:, None] for one, weights in zip(profiles, seen, strict=True)]


def _alpha_at_pixels(profile: DepthProfile) -> np.ndarray:
    """Compute alpha [K] in the pixels that the profile has rays through."""
    return profile.alpha[profile.row[profile.row >= 0]]


def _on_image(profile: DepthProfile, values: np.ndarray) -> np.ndarray:
    """Scatter values [K] over the image [H, W], zero in pixels without a ray."""
    image = np.zeros(profile.row.shape, np.float32)
    image[profile.row >= 0] = values
    return image


def _share_before_hands(own: DepthProfile, seen: np.ndarray, profiles: Sequence[DepthProfile]) -> np.ndarray:
    """Compute the share [H, W] of a hand's light that passes the others; `seen` [K, N] are its weights behind them.

    Outlines of surfaces fit together as they are. Those of rays are those of squares of pixels.
    """
    alpha = _alpha_at_pixels(own)
    share = _on_image(own, seen.sum(1) / np.maximum(alpha, _MIN_ALPHA))
    if all(profile.ray_px == 1 for profile in profiles):
        return np.where(own.row >= 0, np.minimum(share, 1), 1)
    return _softened(share, _on_image(own, alpha))


def _share_before_scene(own: DepthProfile, seen: np.ndarray, scene_depth: np.ndarray) -> np.ndarray:
    """Compute the share [H, W] of that light that passes the scene, too."""
    has_ray = own.row >= 0
    rays, total = own.row[has_ray], seen.sum(1)
    light = opacity_before(scene_depth[has_ray][:, None], own.t[rays], own.dt[rays], seen)[:, 0]
    return _softened(_on_image(own, light / np.maximum(total, _MIN_ALPHA)), _on_image(own, total))


_MIN_ALPHA = 1e-6


def _softened(share: np.ndarray, certainty: np.ndarray) -> np.ndarray:
    """Soften the edges of shares, one pixel wide, and extend them to the pixels beside the rays, with a little alpha.

    Cycles' depth has hard edges, one sample per pixel; without blur, the hand would have them too.
    """
    near, weight = _blurred(share * certainty), _blurred(certainty)
    far, far_weight = _blurred(_blurred(near)), _blurred(_blurred(weight))
    soft = np.where(weight > _MIN_ALPHA, near / np.maximum(weight, _MIN_ALPHA), 1)
    spread = far / np.maximum(far_weight, _MIN_ALPHA)
    return np.clip(np.where((weight <= _MIN_ALPHA) & (far_weight > _MIN_ALPHA), spread, soft), 0, 1)


def _blurred(image: np.ndarray) -> np.ndarray:
    """Apply a 3 x 3 binomial filter, the border repeated."""
    padded = np.pad(image, 1, mode="edge")
    rows = padded[:-2] + 2 * padded[1:-1] + padded[2:]
    return (rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:]) / 16


def _dimmed(frame: Frame, share: np.ndarray) -> Frame:
    alpha = frame.alpha * share
    hidden = alpha < _SOLID_ALPHA
    depth = np.where(hidden, np.float32(DEPTH_BACKGROUND), frame.depth)
    return Frame(frame.rgb * share[..., None], alpha, depth, frame.profile)
