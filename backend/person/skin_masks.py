"""Labels of pictures' pixels: the person's hand, what is no hand, and what may be either.

GrabCut, seeded by the posed mesh, finds the hand in each picture. All pictures together then say what colours the
person's skin has, each picture what its ground has beside the hand; both decide what GrabCut could not: the ground
seen between fingers, and what on the hand is no skin. Before a resting camera a clean plate decides where it can.
Behind the wrist nothing is known, for the arm bends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..capture.masks.mask import MaskConfig, MaskRegions, grabcut_mask, hand_regions, load_opencv, short_of_arm
from ..geometry.tolerances import NEAR_M
from ..hand.lbs import posed_arrays
from ..hand.model import HandModel
from ..records.camera import Camera
from ..records.errors import LiveHandError
from ..records.hand_picture import BACKGROUND, HAND, UNKNOWN
from ..records.shot import HandPose
from ..system.parallel_map import parallel_map
from .clean_plate import CleanPlate, plate_labels
from .other_hands import with_others_unknown

MASKS = MaskConfig(erode_mm=6.0, dilate_mm=16.0)
"""The fit of a film or a photograph is a centimetre off in places."""
_SECOND_ITERATIONS = 3  # of GrabCut, which begins near its end: more move a thousandth of the hand
_WRIST, _MIDDLE_KNUCKLE = 0, 4  # joints
_WRIST_BEND_RAD = 0.6  # in the picture, to each side
_BENDS = 13
_CUFF_M = 0.05  # of the mesh before its end, over which a sleeve may lie
_BINS, _LEVELS = 32, 256  # of a colour's histogram along each axis of Lab
_SMOOTH_BINS = 1.0
_LEAST_SHARE = 1e-5  # of a colour that was never seen
_GROUND_ODDS, _SKIN_ODDS = 4.0, 0.25  # of the ground against skin
_FOREIGN = 8.0  # deviations from the skin's chroma
_REDDER = 0.6  # logarithm of red over green
_LEAST_FOREIGN_PX, _GROWN_PX = 5, 3  # of a spot that is no skin, in a window of 900 px
_WINDOW_PX = 900
_DARK, _CLIPPED = 40, 250  # of 255; darker and brighter colours say nothing of skin
_DARK_SKIN = 70  # of 255: skin so dark may be in the shade of a fist
_RING_PX = 24
_COUNTED = 20000  # pixels of one picture that the skin's colours are from
_DEVIATIONS_OF_MEDIAN = 1.4826  # a normal's standard deviation over its median absolute one
_LEAST_VARIANCE, _KEPT_DEVIATIONS, _ROUNDS = 1e-4, 3.0, 3
_LEAST_RED, _MOST_BLUE = -0.1, 0.25  # logarithms of red and blue over green that skin may have in a usual light


class ColourHistogram(NamedTuple):
    """The chroma of a person's skin: logarithms of red and of blue over green, sRGB decoded.

    Attributes:
        mean: [2].
        precision: [2, 2], inverse covariance.
    """

    mean: np.ndarray
    precision: np.ndarray

    def deviations(self, chroma: np.ndarray) -> np.ndarray:
        """Measure how many deviations chroma [..., 2] is from the mean."""
        return self._length(chroma - self.mean)

    def deviations_from_redder(self, chroma: np.ndarray) -> np.ndarray:
        """Measure the same from skin that is as much redder as fingertips are, and what other skin shines on."""
        off = chroma - self.mean
        redder = off[..., :1].clip(0, _REDDER)
        return self._length(off - np.concatenate([redder, np.zeros_like(redder)], -1))

    def _length(self, off: np.ndarray) -> np.ndarray:
        return np.sqrt(((off @ self.precision) * off).sum(-1, keepdims=True))[..., 0]


@dataclass(frozen=True)
class _Seen:
    """A picture, its regions, GrabCut's first mask, and what stands behind the hand."""

    rgb: np.ndarray
    regions: MaskRegions
    behind_wrist: np.ndarray
    cuff: np.ndarray
    mask: np.ndarray
    plate: CleanPlate | None


def labelled(
    pictures: Sequence[np.ndarray],
    poses: Sequence[HandPose],
    cameras: Sequence[Camera],
    model: HandModel,
    others_px: Sequence[Sequence[np.ndarray]] | None = None,
    plates: Sequence[CleanPlate] | None = None,
) -> list[np.ndarray]:
    """Label the pixels of one person's pictures.

    Args:
        pictures: uint8 [H, W, 3] of right hands, sRGB.
        poses: one a picture.
        cameras: one a picture, in the poses' world.
        model: the right hand's.
        others_px: [21, 2] landmarks of the other hands in each picture; None: there are none.
        plates: one a picture; None: what stands behind the hand is not known.

    Returns:
        uint8 [H, W] a picture: `HAND`, `BACKGROUND` or `UNKNOWN`.

    Raises:
        LiveHandError: OpenCV is missing, or the hand has no skin's colour.
    """
    behind = plates or [None] * len(pictures)
    seen = parallel_map(lambda each: _seen(*each, model), list(zip(pictures, behind, poses, cameras, strict=True)))
    skin = skin_colours([one.rgb[one.mask & one.regions.core] for one in seen])
    check_is_skin(skin)
    histogram = np.sum([_histogram(_lab(one.rgb)[one.mask & one.regions.core]) for one in seen], 0)
    labels = parallel_map(lambda one: _labels(one, skin, histogram), seen)
    others_px = others_px or [()] * len(labels)
    return [
        with_others_unknown(each, one.regions.silhouette, others)
        for each, one, others in zip(labels, seen, others_px, strict=True)
    ]


def skin_colours(samples: Sequence[np.ndarray]) -> ColourHistogram:
    """Fit the chroma of skin to colours uint8 [N, 3], one array a picture; each picture counts alike."""
    rng = np.random.default_rng(0)
    chosen = [each if len(each) <= _COUNTED else rng.choice(each, _COUNTED, replace=False) for each in samples]
    colours = np.concatenate([each[each.max(-1) < _CLIPPED] for each in chosen])
    if not len(colours):
        raise LiveHandError("the pictures must show skin that is not clipped, got white only; expose them less")
    chroma = _chroma(colours)
    mean = np.median(chroma, 0)
    spread = _DEVIATIONS_OF_MEDIAN * np.median(np.abs(chroma - mean), 0)
    skin = ColourHistogram(mean, np.diag(1 / (spread**2 + _LEAST_VARIANCE)))
    for _ in range(_ROUNDS):  # what is worn, and ground in the mask, is no skin
        kept = chroma[skin.deviations(chroma) < _KEPT_DEVIATIONS]
        covariance = np.cov(kept.T) + _LEAST_VARIANCE * np.eye(2)
        skin = ColourHistogram(np.median(kept, 0), np.linalg.inv(covariance))
    return skin


def check_is_skin(skin: ColourHistogram) -> None:
    """Raise LiveHandError if the colours are those of a glove: of no skin in any usual light."""
    red, blue = skin.mean
    if red < _LEAST_RED or blue > _MOST_BLUE:
        raise LiveHandError(
            f"the hand must have the colour of skin, got {np.exp(red):.2f} times as much red and {np.exp(blue):.2f} "
            "times as much blue as green; take off the glove, or use white light"
        )


def where_arm_may_be(pose: HandPose, camera: Camera, model: HandModel) -> np.ndarray:
    """Return the pixels [H, W] at and behind the wrist that a right hand's arm may cover, however the wrist is bent."""
    vertices, joints = posed_arrays(model, pose)
    vertices, faces = short_of_arm(vertices, model)
    regions = hand_regions(vertices, joints, faces, camera, MASKS)
    return _behind_wrist(regions, joints, camera) | _cuff(vertices, joints, regions, camera)


def _seen(rgb: np.ndarray, plate: CleanPlate | None, pose: HandPose, camera: Camera, model: HandModel) -> _Seen:
    vertices, joints = posed_arrays(model, pose)
    vertices, faces = short_of_arm(vertices, model)
    regions = hand_regions(vertices, joints, faces, camera, MASKS)
    behind = _behind_wrist(regions, joints, camera) & ~regions.silhouette
    mask = _coarse_mask(rgb, regions)
    return _Seen(rgb, regions, behind, _cuff(vertices, joints, regions, camera), mask, plate)


def _coarse_mask(rgb: np.ndarray, regions: MaskRegions) -> np.ndarray:
    """Find the mask at half size: enough for the colours of skin, and a second cut finds its edge."""
    cv2 = load_opencv()
    size_px = regions.silhouette.shape[::-1]
    half_px = tuple(max(1, length // 2) for length in size_px)
    small = cv2.resize(rgb, half_px, interpolation=cv2.INTER_AREA)
    halves = (cv2.resize(each.astype(np.uint8), half_px, interpolation=cv2.INTER_NEAREST) > 0 for each in regions)
    mask = grabcut_mask(small, MaskRegions(*halves), MASKS).astype(np.float32)
    return cv2.resize(mask, size_px, interpolation=cv2.INTER_LINEAR) > 0.5


def _cuff(vertices: np.ndarray, joints: np.ndarray, regions: MaskRegions, camera: Camera) -> np.ndarray:
    """Return the part of the silhouette near the mesh's end, which a sleeve may cover that looks like the ground."""
    cv2 = load_opencv()
    elbow = (joints[_WRIST] - joints[_MIDDLE_KNUCKLE]) / np.linalg.norm(joints[_WRIST] - joints[_MIDDLE_KNUCKLE])
    along = vertices @ elbow
    px, depth = camera.project(vertices[along > along.max() - _CUFF_M])
    cuff = np.zeros(regions.silhouette.shape, np.uint8)
    if (depth > NEAR_M).all():
        limit = 8.0 * max(camera.size_px)  # OpenCV counts in 32-bit integers
        cv2.fillConvexPoly(cuff, cv2.convexHull(px.clip(-limit, limit).round().astype(np.int32)), 1)
    return (cuff > 0) & regions.silhouette


def _behind_wrist(regions: MaskRegions, joints: np.ndarray, camera: Camera) -> np.ndarray:
    """Turn the straight arm's region about the wrist, as far as wrists bend in the picture; the hand is no part."""
    cv2 = load_opencv()
    (x, y), _ = camera.project(joints[_WRIST])
    swept = regions.forearm.astype(np.uint8)
    for angle in np.linspace(-_WRIST_BEND_RAD, _WRIST_BEND_RAD, _BENDS):
        turn = cv2.getRotationMatrix2D((float(x), float(y)), float(np.degrees(angle)), 1.0)
        size_px = swept.shape[::-1]
        swept |= cv2.warpAffine(regions.forearm.astype(np.uint8), turn, size_px, flags=cv2.INTER_NEAREST)
    return swept > 0


def _labels(seen: _Seen, skin: ColourHistogram, skin_histogram: np.ndarray) -> np.ndarray:
    cv2 = load_opencv()
    lab = _lab(seen.rgb)
    possible = seen.regions.near | seen.behind_wrist
    ground = ~possible & (cv2.dilate(possible.astype(np.uint8), np.ones((3, 3)), iterations=_RING_PX) > 0)
    odds = _odds(lab, ground, skin_histogram)
    shown = _second_cut(seen, odds)
    is_hand, is_ground, is_either = _labelled_by_plate(seen, ~possible)
    shown = (shown | is_hand) & ~is_ground
    foreign = _foreign(seen, skin, odds) & ~is_ground
    labels = np.full(shown.shape, BACKGROUND, np.uint8)
    labels[shown] = HAND
    labels[(seen.behind_wrist | seen.cuff | is_either) & ~shown] = UNKNOWN
    labels[foreign] = UNKNOWN
    return labels


def _odds(lab: np.ndarray, ground: np.ndarray, skin_histogram: np.ndarray) -> np.ndarray:
    """Compute how much likelier [H, W] a pixel's colour is the ground's than the skin's."""
    skin = skin_histogram / max(skin_histogram.sum(), 1e-9)
    of_ground = _histogram(lab[ground])
    of_ground = of_ground / max(of_ground.sum(), 1e-9)
    bins = tuple(np.moveaxis(lab.astype(int) * _BINS // _LEVELS, -1, 0))
    return (of_ground[bins] + _LEAST_SHARE) / (skin[bins] + _LEAST_SHARE)


def _second_cut(seen: _Seen, odds: np.ndarray) -> np.ndarray:
    """Cut again: what has the ground's colours inside the silhouette may be ground, deep inside it too."""
    is_ground = _opened(odds > _GROUND_ODDS) & seen.regions.near
    is_skin = odds < _SKIN_ODDS
    regions = seen.regions._replace(core=seen.regions.core & ~is_ground & is_skin)
    if not regions.core.any():
        return seen.mask
    again = grabcut_mask(seen.rgb, regions, replace(MASKS, iterations=_SECOND_ITERATIONS))
    return (again | (seen.mask & is_skin)) & ~is_ground & ~seen.behind_wrist


def _labelled_by_plate(seen: _Seen, is_ground: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the pixels [H, W] that the plate tells to be the hand's, the ground's, and too dark to be told."""
    if seen.plate is None:
        none = np.zeros_like(is_ground)
        return none, none, none
    labels = plate_labels(seen.rgb, seen.plate, seen.mask & seen.regions.core, is_ground)
    is_hand = _opened(labels == HAND) & seen.regions.near & ~seen.behind_wrist
    is_dark = (seen.rgb.max(-1) < _DARK_SKIN) & (labels == UNKNOWN) & seen.regions.silhouette
    return is_hand, _opened(labels == BACKGROUND), is_dark


def _foreign(seen: _Seen, skin: ColourHistogram, odds: np.ndarray) -> np.ndarray:
    """Find rings, watches and sleeves: spots in the hand's place of a chroma that skin does not have."""
    cv2 = load_opencv()
    share = max(seen.rgb.shape[:2]) / _WINDOW_PX
    smooth = cv2.GaussianBlur(seen.rgb, (0, 0), max(0.5, 2 * share))
    is_known = (seen.rgb.max(-1) < _CLIPPED) & (seen.rgb.max(-1) > _DARK)
    is_foreign = (skin.deviations_from_redder(_chroma(smooth)) > _FOREIGN) & is_known & seen.regions.silhouette
    is_foreign &= odds <= _GROUND_ODDS
    least, grown = (max(1, round(px * share)) for px in (_LEAST_FOREIGN_PX, _GROWN_PX))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * least + 1, 2 * least + 1))
    spots = cv2.morphologyEx(is_foreign.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    grow = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * grown + 1, 2 * grown + 1))
    return (cv2.dilate(spots, grow) > 0) & seen.regions.silhouette


def _opened(mask: np.ndarray) -> np.ndarray:
    cv2 = load_opencv()
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0


def _lab(rgb: np.ndarray) -> np.ndarray:
    cv2 = load_opencv()
    return cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2LAB)


def _histogram(lab: np.ndarray) -> np.ndarray:
    """Count colours [N, 3], smoothed: [32, 32, 32]."""
    from scipy.ndimage import gaussian_filter

    counts = np.histogramdd(lab.reshape(-1, 3), _BINS, [(0, _LEVELS)] * 3)[0]
    return gaussian_filter(counts / max(counts.sum(), 1.0), _SMOOTH_BINS)


def _chroma(rgb: np.ndarray) -> np.ndarray:
    linear = (rgb.astype(np.float32) / 255) ** 2.2 + 0.002
    log = np.log(linear)
    return np.stack([log[..., 0] - log[..., 1], log[..., 2] - log[..., 1]], -1)
