"""Tracks hands from frame to frame: a hand is looked for where it was; palms are searched for only now and then."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import UInt8

from ..records.errors import LiveHandError
from .crop import HandRegion, cropped, region_of_landmarks
from .networks import TorchNetwork
from .palm_search import find_hands, other_views
from .tracked_hand import TrackedHand, is_same_hand
from .weights import TrackerNetworks

_LEAST_PRESENCE = 0.5
_SURE_PRESENCE = 0.9  # below it, the palm is searched for too, and the surer of both regions is taken
_SAME_HAND = 0.5  # overlap of two regions of one hand
_NEAR = 0.1  # overlap of a region found anew with the one where the hand was
_SEARCH_EVERY = 10  # frames


@dataclass(frozen=True)
class _Followed:
    """A hand's number, where it is looked for next, and what is seen there beyond the picture (`cropped`)."""

    track: int
    region: HandRegion
    repeats_edge: bool = True


class HandTracker:
    """Follows hands through pictures given in order; another is searched for every few of them."""

    def __init__(self, networks: TrackerNetworks, most_hands: int = 2, search_every: int = _SEARCH_EVERY):
        self._palm, self._hand = TorchNetwork(networks.palm), TorchNetwork(networks.hand)
        self._most_hands, self._search_every = most_hands, search_every
        self._followed: list[_Followed] = []
        self._tracks = self._frames = self._others_tried = 0

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
        searches = not was_followed or self._frames % self._search_every == 0
        self._frames += 1
        if searches and len(self._followed) < self._most_hands:
            for region in find_hands(picture, self._palm):
                self._follow(region)
        hands = self._looked_at(picture, is_searched=not was_followed)
        if hands or was_followed:
            return hands
        return self._found_in_another_view(picture)

    def look(
        self, picture: UInt8[np.ndarray, "H W 3"], region: HandRegion, track: int = 0, repeats_edge: bool = True
    ) -> TrackedHand:
        """Look at a region of a picture, whether it shows a hand or not; the result's presence tells."""
        side = self._hand.size_px
        outputs = self._hand(cropped(picture, region, side, repeats_edge))
        points, presence, right, world = (output[0].numpy().astype(np.float64) for output in outputs)
        px = region.to_px(points.reshape(21, 3)[:, :2] / side)
        world = world.reshape(21, 3).copy()
        world[:, :2] = world[:, :2] @ region.rotation.T
        return TrackedHand(track, px, world, float(presence[0]), float(right[0]))

    def _found_in_another_view(self, picture: np.ndarray) -> list[TrackedHand]:
        """Look into one of the other views in every frame without hands, at twice the cost; one that helps stays."""
        views = other_views(picture)
        for region in find_hands(picture, self._palm, views[self._others_tried % len(views)]):
            self._follow(region, repeats_edge=False)  # a hand that fills the picture would grow at its edge
        hands = self._looked_at(picture, is_searched=True)
        self._others_tried += not hands
        return hands

    def _follow(self, region: HandRegion, repeats_edge: bool = True) -> None:
        known = any(region.overlap(other.region) > _SAME_HAND for other in self._followed)
        if not known and len(self._followed) < self._most_hands:
            self._followed.append(_Followed(self._tracks, region, repeats_edge))
            self._tracks += 1

    def _looked_at(self, picture: np.ndarray, is_searched: bool) -> list[TrackedHand]:
        hands: list[TrackedHand] = []
        followed: list[_Followed] = []
        for one in self._followed:
            hand = self.look(picture, one.region, one.track, one.repeats_edge)
            if hand.presence < _SURE_PRESENCE and not is_searched:
                near = [at for at in find_hands(picture, self._palm) if at.overlap(one.region) > _NEAR]
                hand = max((hand, *(self.look(picture, at, one.track, one.repeats_edge) for at in near)), key=_presence)
            region = region_of_landmarks(hand.px)
            is_new = not any(region.overlap(other.region) > _SAME_HAND for other in followed)
            is_new = is_new and not any(is_same_hand(hand.px, other.px) for other in hands)
            if hand.presence >= _LEAST_PRESENCE and is_new and region.side_px >= 1:
                hands.append(hand)
                followed.append(replace(one, region=region))
        self._followed = followed
        return hands


def _presence(hand: TrackedHand) -> float:
    return hand.presence
