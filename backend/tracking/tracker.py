"""Tracks hands from frame to frame: a hand is looked for where it was; palms are searched for only now and then."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import torch
from jaxtyping import UInt8

from ..records.errors import LiveHandError
from .crop import HandRegion, cropped, region_of_extent, region_of_landmarks, upward_angle
from .networks import TorchNetwork
from .tracked_hand import TrackedHand
from .weights import TrackerNetworks

_GRIDS = ((24, 2), (12, 6))  # cells per side, anchors per cell
_LEAST_SCORE = 0.5
_MOST_OVERLAP = 0.3  # of two finds of different palms
_LARGEST_LOGIT = 100.0
_WRIST, _MIDDLE_KNUCKLE = 0, 2  # among a palm's seven points
_PALM_SCALE, _PALM_SHIFT = 2.6, -0.5  # of a hand's region against its palm's box


def find_hands(picture: UInt8[np.ndarray, "H W 3"], detector: TorchNetwork) -> list[HandRegion]:
    """Find the regions of the hands in a picture, the surest first."""
    height, width = picture.shape[:2]
    whole = HandRegion(np.array([width, height]) / 2, float(max(width, height)), 0.0)
    boxes, logits = detector(cropped(picture, whole, detector.size_px, repeats_edge=False))
    scores = 1 / (1 + np.exp(-np.clip(logits[0, :, 0].numpy(), -_LARGEST_LOGIT, _LARGEST_LOGIT)))
    is_palm = scores >= _LEAST_SCORE
    palms = _decoded(boxes[0].numpy()[is_palm], _anchors()[is_palm], detector.size_px)
    return [_region(whole.to_px(palm)) for palm in merged(palms, scores[is_palm])]


def merged(palms: np.ndarray, scores: np.ndarray) -> list[np.ndarray]:
    """Apply weighted non-maximum suppression: overlapping detections become their mean, weighted by score.

    Args:
        palms: [N, 9, 2] upper left and lower right corner of the box, then the palm's points.
        scores: [N] in (0, 1).
    """
    rest, found = np.argsort(-scores, kind="stable"), []
    while len(rest):
        same = _overlaps(palms[rest[0]], palms[rest]) > _MOST_OVERLAP
        same[0] = True
        found.append(np.average(palms[rest[same]], 0, scores[rest[same]]))
        rest = rest[~same]
    return found


@cache
def _anchors() -> np.ndarray:
    """List the anchors: [2016, 2] centres, shares of the picture, row by row."""
    grids = []
    for cells, count in _GRIDS:
        rows, columns = np.divmod(np.arange(cells * cells), cells)
        grids.append(np.repeat((np.stack([columns, rows], 1) + 0.5) / cells, count, 0))
    return np.concatenate(grids)


def _decoded(raw: np.ndarray, anchors: np.ndarray, size_px: int) -> np.ndarray:
    """Decode to [N, 9, 2] shares of the picture: both corners of the box, then seven points."""
    pairs = raw.reshape(len(raw), 9, 2) / size_px
    centre, half = pairs[:, 0] + anchors, pairs[:, 1] / 2
    return np.concatenate([(centre - half)[:, None], (centre + half)[:, None], pairs[:, 2:] + anchors[:, None]], 1)


def _overlaps(one: np.ndarray, palms: np.ndarray) -> np.ndarray:
    """Compute the intersection over union [N] of one box with others."""
    low, high = np.maximum(one[0], palms[:, 0]), np.minimum(one[1], palms[:, 1])
    shared = np.maximum(high - low, 0).prod(-1)
    both = np.prod(one[1] - one[0]) + (palms[:, 1] - palms[:, 0]).prod(-1) - shared
    return shared / np.maximum(both, np.finfo(float).tiny)


def _region(palm_px: np.ndarray) -> HandRegion:
    low, high, points = palm_px[0], palm_px[1], palm_px[2:]
    angle = upward_angle(points[_WRIST], points[_MIDDLE_KNUCKLE])
    return region_of_extent((low + high) / 2, high - low, angle, _PALM_SCALE, _PALM_SHIFT)


_LEAST_PRESENCE = 0.5
_SURE_PRESENCE = 0.9  # below it, the palm is searched for too, and the surer of both regions is taken
_SAME_HAND = 0.5  # overlap of two regions of one hand
_NEAR = 0.1  # overlap of a region found anew with the one where the hand was
_SEARCH_EVERY = 10  # frames, while a hand is tracked and another may come


@dataclass(frozen=True)
class _Followed:
    """A hand's number, and where it is looked for next."""

    track: int
    region: HandRegion


class HandTracker:
    """Follows hands through pictures given in order."""

    def __init__(self, networks: TrackerNetworks, most_hands: int = 2):
        self._palm, self._hand = TorchNetwork(networks.palm), TorchNetwork(networks.hand)
        self._most_hands = most_hands
        self._followed: list[_Followed] = []
        self._tracks = self._frames = 0

    def warm_up(self) -> None:
        """Run both networks once, which prepares what they need."""
        for network in (self._palm, self._hand):
            network(torch.zeros(1, 3, network.size_px, network.size_px))

    def track(self, picture: UInt8[np.ndarray, "H W 3"]) -> list[TrackedHand]:
        """Track the hands in the next picture, sRGB.

        Raises:
            LiveHandError: the picture is empty.
        """
        if min(picture.shape[:2]) < 1:
            raise LiveHandError(f"a picture must have pixels, got {picture.shape[1]} x {picture.shape[0]}")
        was_followed = bool(self._followed)
        searches = not was_followed or self._frames % _SEARCH_EVERY == 0
        self._frames += 1
        if searches and len(self._followed) < self._most_hands:
            for region in find_hands(picture, self._palm):
                self._follow(region)
        return self._looked_at(picture, is_searched=not was_followed)

    def look(self, picture: UInt8[np.ndarray, "H W 3"], region: HandRegion, track: int = 0) -> TrackedHand:
        """Look at a region of a picture, whether it shows a hand or not; the result's presence tells."""
        side = self._hand.size_px
        outputs = self._hand(cropped(picture, region, side, repeats_edge=True))
        points, presence, right, world = (output[0].numpy().astype(np.float64) for output in outputs)
        px = region.to_px(points.reshape(21, 3)[:, :2] / side)
        world = world.reshape(21, 3).copy()
        world[:, :2] = world[:, :2] @ region.rotation.T
        return TrackedHand(track, px, world, float(presence[0]), float(right[0]))

    def _follow(self, region: HandRegion) -> None:
        known = any(region.overlap(other.region) > _SAME_HAND for other in self._followed)
        if not known and len(self._followed) < self._most_hands:
            self._followed.append(_Followed(self._tracks, region))
            self._tracks += 1

    def _looked_at(self, picture: np.ndarray, is_searched: bool) -> list[TrackedHand]:
        hands: list[TrackedHand] = []
        followed: list[_Followed] = []
        for one in self._followed:
            hand = self.look(picture, one.region, one.track)
            if hand.presence < _SURE_PRESENCE and not is_searched:
                near = [at for at in find_hands(picture, self._palm) if at.overlap(one.region) > _NEAR]
                hand = max((hand, *(self.look(picture, at, one.track) for at in near)), key=_presence)
            region = region_of_landmarks(hand.px)
            is_new = not any(region.overlap(other.region) > _SAME_HAND for other in followed)
            if hand.presence >= _LEAST_PRESENCE and is_new and region.side_px >= 1:
                hands.append(hand)
                followed.append(replace(one, region=region))
        self._followed = followed
        return hands


def _presence(hand: TrackedHand) -> float:
    return hand.presence
