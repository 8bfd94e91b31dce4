"""Finds which way forearms go on from hands whose landmarks are fitted: landmarks say nothing of them.

Directions within a wrist's reach are tried, then finer ones around the best: the forearm's skin next to the wrist lies
on pixels that look like the hand's own in as many pictures as can be. What is hidden behind a hand, or looks like
neither skin nor bare ground, decides little; a sleeve's cloth is one of these.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from scipy.ndimage import map_coordinates
from torch import Tensor

from ...geometry.rotation import axis_angle_to_matrix
from ...records.camera import Camera
from .calibration import RigView
from .outlines import NONE, covered_pixels
from .rig_hands import HandParameters, RigHands
from .view_masks import FREE, RIGHT, sure_skin_likelihood

_BENT_RAD, _SIDEWAYS_RAD = 1.4, 0.7  # that wrists reach to each side
_STEP_RAD, _FINER_RAD = 0.2, (0.1, 0.05)
_NEAR_M = 0.1  # of the wrist, where sleeves end
_LEAST_ARM = 0.9  # weight of vertices that move with the forearm alone
_MOST_POINTS = 150  # of a forearm
_STRAIGHT = 0.03  # cost of a square radian
_BETTER = 0.03  # than straight on, to be believed
_LEAST_SCORE = 0.05  # of an arm that is seen; of one behind a hand or in a sleeve it is 0 or less


def with_forearms(
    parameters: HandParameters,
    hands: RigHands,
    views: Sequence[RigView],
    cameras: Sequence[Camera],
    held_out: Collection[int] = (),
) -> HandParameters:
    """Turn forearms to where the pictures show skin beyond the wrists; one that is not seen goes on straight.

    Args:
        parameters: of hands fitted to landmarks.
        hands: the model.
        views: of the rig.
        cameras: of the views, turned.
        held_out: rows of views that may not move the hands.
    """
    straight = parameters._replace(forearm=torch.zeros_like(parameters.forearm))
    shown = hands.show(straight)
    rows = [row for row in range(len(views)) if row not in held_out]
    looks = [_Likeness.of(shown.all_vertices.double().numpy(), hands, views[row], cameras[row]) for row in rows]
    found = [
        _best_forearm(
            _Forearm(
                axis_angle_to_matrix(parameters.theta[number, 0].double().numpy()),
                shown.landmarks[number, 0].double().numpy(),
                shown.vertices[number, _vertices_near_wrist(hands)].double().numpy(),
            ),
            looks,
        )
        for number in range(len(hands.sides))
    ]
    return parameters._replace(forearm=torch.as_tensor(np.stack(found), dtype=parameters.forearm.dtype))


@dataclass(frozen=True)
class _Likeness:
    """How much each pixel of a view looks like skin, -0.5 to 0.5; 0 where a hand is."""

    skin: Float[np.ndarray, "H W"]
    camera: Camera

    @classmethod
    def of(cls, vertices: np.ndarray, hands: RigHands, view: RigView, camera: Camera) -> _Likeness:
        is_hand = covered_pixels(vertices, hands.faces[~hands.arm_faces], camera).face != NONE
        depth_m = float(np.median(camera.project(vertices)[1]))
        mesh = np.where(is_hand, RIGHT, FREE).astype(np.uint8)
        likelihood = sure_skin_likelihood(view.rgb, mesh, camera.K[0, 0] / depth_m / 1000)
        return cls(np.where(is_hand, 0, likelihood - 0.5), camera)

    def at(self, points: Float[np.ndarray, "N P 3"]) -> Float[np.ndarray, "N P"]:
        """Look up world points; 0 outside the picture."""
        px, depth = self.camera.project(points.reshape(-1, 3))
        inside = (depth > 0) & ((px > 0) & (px < self.camera.size_px)).all(1)
        shown = map_coordinates(self.skin, px[inside].T[::-1] - 0.5, order=0, mode="nearest")
        found = np.zeros(len(px))
        found[inside] = shown
        return found.reshape(points.shape[:2])


class _Forearm(NamedTuple):
    """A forearm that goes on straight: rotation of the hand [3, 3], wrist [3] and points [P, 3] m, world."""

    rotation: np.ndarray
    wrist: np.ndarray
    points: np.ndarray

    def turned(self, forearms: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "N P 3"]:
        """Turn it about the wrist, as `HandPose` has it."""
        turns = self.rotation @ axis_angle_to_matrix(forearms) @ self.rotation.T
        return self.wrist + (self.points - self.wrist) @ turns.swapaxes(1, 2)


def _best_forearm(forearm: _Forearm, looks: Sequence[_Likeness]) -> np.ndarray:
    bends, sides = (np.arange(-most, most + 1e-6, _STEP_RAD) for most in (_BENT_RAD, _SIDEWAYS_RAD))
    tried = np.array([(0.0, side, bend) for side in sides for bend in bends])
    best = np.zeros(3)
    best_score = max(_LEAST_SCORE, _scores(best[None], forearm, looks)[0] + _BETTER)
    for step in (*_FINER_RAD, 0.0):
        scores = _scores(tried, forearm, looks)
        if scores.max() > best_score:
            best, best_score = tried[scores.argmax()], scores.max()
        tried = best + step * np.array([(0.0, y, z) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    return best


def _scores(tried: Float[np.ndarray, "N 3"], forearm: _Forearm, looks: Sequence[_Likeness]) -> Float[np.ndarray, " N"]:
    """Compute how well each turn lies on skin, all views together."""
    points = forearm.turned(tried)
    return np.mean([look.at(points).mean(1) for look in looks], 0) - _STRAIGHT * (tried**2).sum(1)


def _vertices_near_wrist(hands: RigHands) -> Tensor:
    """List some of the forearm's vertices near the wrist."""
    wrist = hands.skin.J_regressor[0] @ hands.skin.v_template
    off_m = (hands.skin.v_template - wrist).norm(dim=1)
    near = ((hands.skin.arm_weights > _LEAST_ARM) & (off_m < _NEAR_M)).nonzero()[:, 0]
    return near[:: max(1, len(near) // _MOST_POINTS)]
