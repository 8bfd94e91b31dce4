"""The hands of one still picture: every view of it is searched, and each hand is looked at several times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from .crop import HandRegion, region_of_landmarks
from .networks import TorchNetwork
from .palm_search import find_hands, other_views
from .tracked_hand import TrackedHand, is_same_hand
from .tracker import HandTracker
from .weights import TrackerNetworks

SEARCHED_PX = 1280
"""Longer side of the picture that is searched: the networks see hands of about 200 px."""
_SETTLING_LOOKS = 3
_BORDER = 0.5  # of the longer side, black, on each side
_LEAST_PRESENCE = 0.5
_JITTERS = ((0.0, 1.0), (0.17, 1.08), (-0.17, 0.94), (0.09, 0.96), (-0.09, 1.1))  # turn, rad, and scale


class StillTracker:
    """Finds the hands of pictures that have nothing to do with one another."""

    def __init__(self, networks: TrackerNetworks, most_hands: int = 4):
        self._palm, self._tracker, self._most = TorchNetwork(networks.palm), HandTracker(networks), most_hands

    def hands(self, picture: UInt8[np.ndarray, "H W 3"]) -> list[TrackedHand]:
        """Find the hands, the surest first; landmarks are in the picture's own pixels."""
        share = min(1.0, SEARCHED_PX / max(picture.shape[:2]))
        small = picture if share == 1 else _reduced(picture, share)
        border_px = round(_BORDER * max(small.shape[:2]))
        bordered = np.pad(small, ((border_px, border_px), (border_px, border_px), (0, 0)))
        hands: list[TrackedHand] = []
        inside = HandRegion(np.array(bordered.shape[1::-1]) / 2, float(max(small.shape[:2])), 0.0)
        for view in (inside, *other_views(small)):
            at = view if view is inside else replace(view, centre_px=view.centre_px + border_px)
            for region in find_hands(bordered, self._palm, at):
                self._add(hands, bordered, region, len(hands))
            if hands:
                break
        scale = np.array(picture.shape[1::-1]) / small.shape[1::-1]
        return [
            replace(hand, px=(hand.px - border_px) * scale) for hand in sorted(hands, key=lambda one: -one.presence)
        ]

    def _add(self, hands: list[TrackedHand], picture: np.ndarray, region: HandRegion, track: int) -> None:
        hand = self._settled(picture, region, track)
        is_new = not any(is_same_hand(hand.px, other.px) for other in hands)
        if hand.presence >= _LEAST_PRESENCE and is_new and len(hands) < self._most:
            hands.append(hand)

    def _settled(self, picture: np.ndarray, region: HandRegion, track: int) -> TrackedHand:
        """Look until the region is the hand's own, then from regions a little turned and scaled: the median counts."""
        hand = self._tracker.look(picture, region, track)
        for _ in range(_SETTLING_LOOKS if hand.presence >= _LEAST_PRESENCE else 0):
            again = self._tracker.look(picture, region_of_landmarks(hand.px), track)
            if again.presence < _LEAST_PRESENCE:
                break
            hand = again
        if hand.presence < _LEAST_PRESENCE:
            return hand
        own = region_of_landmarks(hand.px)
        looks = [
            self._tracker.look(
                picture, replace(own, side_px=own.side_px * scale, angle_rad=own.angle_rad + turn_rad), track
            )
            for turn_rad, scale in _JITTERS
        ]
        looks = [look for look in looks if look.presence >= _LEAST_PRESENCE] or [hand]
        return replace(
            hand,
            px=np.median([look.px for look in looks], 0),
            world=np.median([look.world for look in looks], 0),
            presence=float(np.mean([look.presence for look in looks])),
            right=float(np.mean([look.right for look in looks])),
        )


def _reduced(picture: np.ndarray, share: float) -> np.ndarray:
    width, height = (max(1, round(side * share)) for side in picture.shape[1::-1])
    return np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.BOX))
