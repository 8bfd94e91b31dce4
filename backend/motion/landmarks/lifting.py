"""Lifting: from a tracker's landmarks to our joints' positions in the picture and their angles, each with a deviation.

A tracker's points are not our joints. Where they lie beside them, and how far they are to be trusted, depends on the
pose and on the side from which it is seen: a small network has learnt it from pictures of our own hand, whose truth is
known (`examples/learn_landmarks.py` makes the pictures and trains it).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import resources
from typing import NamedTuple

import numpy as np

_KNUCKLES = (1, 5, 13)  # nodes of index, middle and ring finger: with the wrist, they say where a hand points
_UNUSUAL = 4.0  # deviations of an input; larger ones are clipped, for the network has not seen them
_LEAST_SHARE = 0.5  # of an estimate's precision that landmarks give, not the poses of the training
_FILE = "mediapipe_lifting.npz"


class LiftedLandmarks(NamedTuple):
    """What the landmarks of T frames say of a right hand.

    Attributes:
        picture_points: [T, 21, 2] the skeleton's nodes in the picture, as landmarks are given.
        points_sd: [T, 21] their standard deviations.
        free: [T, 21] free joint angles, rad.
        free_sd: [T, 21] theirs, rad; infinite where nothing is said of them.
    """

    picture_points: np.ndarray
    points_sd: np.ndarray
    free: np.ndarray
    free_sd: np.ndarray


Lifting = Callable[[np.ndarray, np.ndarray], LiftedLandmarks]
"""Lifts a right hand's landmarks at the skeleton's nodes: points [T, 21, 2] in the picture, (px - principal point) /
focal length, and world landmarks [T, 21, 3] in the camera's axes (OpenCV's), of any scale."""


def mediapipe_lifting(picture_points: np.ndarray, world: np.ndarray) -> LiftedLandmarks:
    """Lift MediaPipe's landmarks by the network."""
    view = CanonicalView.of(picture_points)
    network, usual = _network()
    mean, log_sd = network(view.features(picture_points, world))
    off = mean[:, :42].reshape(-1, 21, 2)
    sd = np.exp(log_sd[:, :42]).reshape(-1, 21, 2).mean(-1)
    free, free_sd = usual.taken_out(mean[:, 42:], np.exp(log_sd[:, 42:]))
    return LiftedLandmarks(view.back(view.shown(picture_points) + off), sd * view.size[:, None], free, free_sd)


class UsualAngles(NamedTuple):
    """What is known of hands that nobody has seen: means and standard deviations [21], rad, of free angles."""

    mean: np.ndarray
    sd: np.ndarray

    def taken_out(self, free: np.ndarray, free_sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reduce estimates [T, 21] to what was seen, by Gaussians: value and standard deviation.

        An estimate is drawn towards what is usual, the less was seen the more: bent fingers come out too straight. A
        fit has natural poses of its own and would draw them there a second time.
        """
        share = np.maximum(1 - (free_sd / self.sd) ** 2, _LEAST_SHARE)
        return self.mean + (free - self.mean) / share, free_sd / np.sqrt(share)


class CanonicalView(NamedTuple):
    """How hands are seen along the rays through their middles, knuckles up and of unit size: what the network knows.

    Attributes:
        rotation: [T, 3, 3] from the camera's axes to the view's.
        turn: [T, 3, 3] the part of it about the camera's axis, by which world landmarks turn.
        middle: [T, 2] of the nodes in the view.
        size: [T] root mean square distance of the nodes from it.
    """

    rotation: np.ndarray
    turn: np.ndarray
    middle: np.ndarray
    size: np.ndarray

    @classmethod
    def of(cls, picture_points: np.ndarray) -> CanonicalView:
        """Choose the view of hands with nodes at points [T, 21, 2]."""
        towards = _along_axis(picture_points.mean(1))
        ahead = _projected(picture_points, towards)
        up = ahead[:, _KNUCKLES].mean(1) - ahead[:, 0]
        turn = _about_axis(np.arctan2(-up[:, 0], -up[:, 1]))
        rotation = turn @ towards
        shown = _projected(picture_points, rotation)
        middle = shown.mean(1)
        return cls(rotation, turn, middle, np.sqrt(((shown - middle[:, None]) ** 2).sum(-1).mean(1)))

    def shown(self, picture_points: np.ndarray) -> np.ndarray:
        """Convert points of the picture to the view, [T, N, 2]."""
        return (_projected(picture_points, self.rotation) - self.middle[:, None]) / self.size[:, None, None]

    def back(self, shown: np.ndarray) -> np.ndarray:
        """Convert points of the view to the picture, [T, N, 2]."""
        return _projected(shown * self.size[:, None, None] + self.middle[:, None], self.rotation.swapaxes(1, 2))

    def features(self, picture_points: np.ndarray, world: np.ndarray) -> np.ndarray:
        """Return [T, 105] what the network gets: points in the view, and the world landmarks turned, of unit size."""
        turned = (world - world.mean(1, keepdims=True)) @ self.turn.swapaxes(1, 2)
        scale = np.sqrt((turned**2).sum(-1).mean(1))[:, None, None]
        parts = (self.shown(picture_points), turned / scale)
        return np.concatenate([part.reshape(len(picture_points), -1) for part in parts], 1)


class LiftingNetwork(NamedTuple):
    """Dense layers with SiLU between them; the last gives means and logarithms of deviations.

    Attributes:
        centre, spread: [I] of the inputs in training.
        weights, biases: of the layers, [out, in] and [out].
    """

    centre: np.ndarray
    spread: np.ndarray
    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]

    def __call__(self, features: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Predict means and logarithms of standard deviations, [T, O] each, from features [T, I]."""
        x = np.clip((features - self.centre) / self.spread, -_UNUSUAL, _UNUSUAL)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = x @ weight.T + bias
            x = x / (1 + np.exp(-x))
        mean, log_sd = np.split(x @ self.weights[-1].T + self.biases[-1], 2, -1)
        return mean, log_sd


@cache
def _network() -> tuple[LiftingNetwork, UsualAngles]:
    """Return the network, and the angles of the poses that it was trained on."""
    with resources.files(str(__package__)).joinpath(_FILE).open("rb") as file, np.load(file) as arrays:
        values = {name: arrays[name].astype(np.float64) for name in arrays.files}
    count = sum(name.startswith("weight") for name in values)
    layers = [tuple(values[f"{kind}{k}"] for k in range(count)) for kind in ("weight", "bias")]
    network = LiftingNetwork(values["centre"], values["spread"], layers[0], layers[1])
    return network, UsualAngles(values["usual_mean"], values["usual_sd"])


def _along_axis(picture_points: np.ndarray) -> np.ndarray:
    """Compute the shortest rotations [T, 3, 3] that bring the rays through points [T, 2] onto the camera's axis."""
    rays = _rays(picture_points)
    x, y, z = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).T
    share = 1 / (1 + z)
    rows = [[1 - x * x * share, -x * y * share, -x], [-x * y * share, 1 - y * y * share, -y], [x, y, z]]
    return np.stack([np.stack(row, -1) for row in rows], 1)


def _about_axis(angle: np.ndarray) -> np.ndarray:
    """Compute [T, 3, 3] rotations by angles [T] about the camera's axis."""
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0] = np.sin(angle)
    turn[:, 0, 1] = -turn[:, 1, 0]
    turn[:, 2, 2] = 1
    return turn


def _rays(picture_points: np.ndarray) -> np.ndarray:
    return np.concatenate([picture_points, np.ones((*picture_points.shape[:-1], 1))], -1)


def _projected(picture_points: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Project points [T, N, 2] to where they are seen after rotations [T, 3, 3]."""
    turned = _rays(picture_points) @ rotation.swapaxes(1, 2)
    return turned[..., :2] / turned[..., 2:]
