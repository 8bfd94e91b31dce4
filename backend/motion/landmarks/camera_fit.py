"""Fits all frames of a take at once to landmarks in the picture, through its camera.

A maximum a posteriori estimate. The picture's landmarks carry the information and have a robust error; world landmarks,
which mislead in depth, start the fit and hold it weakly. Free angles have the distribution of natural poses and hard
limits; angles, rotation and place accelerate little, by the frames' true times. Every step solves all frames together
(Gauss-Newton). Frames without landmarks follow from their neighbours.

Axes are the camera's (OpenCV's), whose optical centre is the origin; places in the picture are divided by the focal
length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ...hand.joint_limits import FREE
from .articulation import NaturalPoses, all_angles, within_limits
from .block_solver import solve_pentadiagonal
from .definition import TrackerDefinition
from .initial_pose import aligned_bones, aligned_palm
from .skeleton import NODES_OF_LANDMARKS, HandSkeleton, PosedSkeleton, node_jacobian

_COLUMNS = np.concatenate([np.arange(6), 6 + FREE])
_UNKNOWNS = len(_COLUMNS)
_FRAMES_AT_ONCE = 256  # bounds memory
_PLACE_STEPS = 3
_LEAST_DEPTH_M = 0.02
_LEAST_GAIN = 1e-4  # relative, of the cost; a smaller one ends the fit


class FitWeights(NamedTuple):
    """Standard deviations of what a fit trusts.

    Attributes:
        picture: of the picture's landmarks, share of the hand's size in it.
        huber: residual, in deviations, from which a landmark counts less.
        across_m, deep_m: of world landmarks, across and along the camera's axis.
        prior: weight of natural poses.
        angle_rad, turn_rad, place_m: acceleration of angles, wrist's rotation and place, per frame^2 at 30 a second.
    """

    picture: float = 0.018
    huber: float = 2.0
    across_m: float = 0.02
    deep_m: float = 0.03
    prior: float = 4.0
    angle_rad: float = 0.05
    turn_rad: float = 0.03
    place_m: float = 0.004


class CameraPoses(NamedTuple):
    """T poses: root [T, 3, 3], wrist [T, 3] m, free angles [T, 21]."""

    root: np.ndarray
    wrist: np.ndarray
    free: np.ndarray

    def stepped(self, step: np.ndarray) -> CameraPoses:
        """The poses after a step [T, 27] of rotation, place and angles, within the limits."""
        root = axis_angle_to_matrix(step[:, :3]) @ self.root
        return CameraPoses(root, self.wrist + step[:, 3:6], within_limits(self.free + step[:, 6:]))


@dataclass(frozen=True)
class Sighting2D:
    """A right hand's landmarks in T frames of one camera, at the skeleton's nodes.

    Attributes:
        places: [T, 21, 2] (px - principal point) / focal length; of frames without the hand, zero.
        world: [T, 21, 3] m about their centre, of the size of the skeleton.
        size: [T] of the hand, divided by the focal length too.
        is_seen: [T].
        times: [T] s, increasing.
    """

    places: np.ndarray
    world: np.ndarray
    size: np.ndarray
    is_seen: np.ndarray
    times: np.ndarray


@dataclass(frozen=True)
class CameraProblem:
    """The poses of one hand of known shape that explain a take."""

    sighting: Sighting2D
    skeleton: HandSkeleton
    offsets: np.ndarray
    definition: TrackerDefinition
    natural: NaturalPoses
    weights: FitWeights

    def initial(self) -> CameraPoses:
        """The world landmarks' poses, placed in closed form where the picture shows them; linear in time in gaps."""
        seen = self.sighting
        rest = np.concatenate([np.zeros((1, 3)), np.cumsum(self.offsets, 1).reshape(20, 3)])
        root, _ = aligned_palm(seen.world, rest)
        free = within_limits(aligned_bones(seen.world, root, self.skeleton, np.zeros(10)))
        wrist = np.zeros((len(root), 3))
        poses = CameraPoses(root, wrist, free)
        points = self.points(poses, self.posed(poses))
        wrist = placed(points, seen.places)
        nearest = _nearest_seen(seen.is_seen)
        filled = [np.interp(seen.times, seen.times[seen.is_seen], column[seen.is_seen]) for column in wrist.T]
        return CameraPoses(root[nearest], np.stack(filled, 1), free[nearest])

    def solve(self, poses: CameraPoses, steps: int, held: int = 0) -> CameraPoses:
        """Step all frames but those held, the first few.

        A step that raises the cost is taken back, and the next one is more careful.
        """
        cost, damping = self.cost(poses), 1e-3
        for _ in range(steps):
            new = poses.stepped(self._step(poses, damping, held))
            new_cost = self.cost(new)
            if new_cost >= cost:
                damping *= 10
                continue
            gain, poses, cost, damping = (cost - new_cost) / cost, new, new_cost, damping / 5
            if gain < _LEAST_GAIN:
                break
        return poses

    def posed(self, poses: CameraPoses) -> PosedSkeleton:
        """The skeleton in the poses."""
        return self.skeleton.pose(poses.root, poses.wrist, all_angles(poses.free), self.offsets)

    def points(self, poses: CameraPoses, posed: PosedSkeleton) -> np.ndarray:
        """[T, 21, 3] m where the tracker sees its landmarks."""
        return self.definition.points(posed)

    def cost(self, poses: CameraPoses) -> float:
        """Twice the negative logarithm of the posterior, but for a constant."""
        total = 0.0
        for part, seen in self._parts(poses):
            points = self.points(part, self.posed(part))
            picture, world = self._residuals(points, seen)
            total += float((_huber(np.linalg.norm(picture, axis=-1), self.weights.huber)).sum())
            total += float(_huber(np.linalg.norm(world, axis=-1), self.weights.huber).sum())
            off = part.free - self.natural.mean
            total += self.weights.prior * float(((off @ self.natural.precision) * off).sum())
        return total + float((self._accelerations(poses) ** 2).sum())

    def reprojection(self, poses: CameraPoses) -> np.ndarray:
        """[T] root mean square distance of the landmarks in the picture from the hand's, as a share of its size."""
        found = []
        for part, seen in self._parts(poses):
            points = self.points(part, self.posed(part))
            off = points[..., :2] / points[..., 2:] - seen.places
            found.append(np.sqrt((off**2).sum(-1).mean(1)) / seen.size)
        return np.where(self.sighting.is_seen, np.concatenate(found), np.nan)

    def _step(self, poses: CameraPoses, damping: float, held: int) -> np.ndarray:
        blocks, rights = zip(*(self._normal(part, seen) for part, seen in self._parts(poses)), strict=True)
        diagonal, right = np.concatenate(blocks), np.concatenate(rights)
        next_ties, second_ties = self._add_smoothness(diagonal, right, poses)
        k = np.arange(_UNKNOWNS)
        diagonal[:, k, k] *= 1 + damping
        step = np.zeros_like(right)
        step[held:] = solve_pentadiagonal(diagonal[held:], next_ties[held:], second_ties[held:], right[held:])
        return step

    def _normal(self, poses: CameraPoses, seen: Sighting2D) -> tuple[np.ndarray, np.ndarray]:
        """[T, 27, 27] and [T, 27] of each frame alone."""
        posed = self.posed(poses)
        points = self.points(poses, posed)
        slopes = node_jacobian(posed, points)[..., _COLUMNS]
        matrix, right = self._prior(poses)
        for residual, jacobian in zip(self._residuals(points, seen), self._slopes(points, slopes, seen), strict=True):
            length = np.linalg.norm(residual, axis=-1)
            trust = np.sqrt(np.minimum(1, self.weights.huber / np.maximum(length, 1e-12)))[..., None]
            rows = (jacobian * trust[..., None]).reshape(len(points), -1, _UNKNOWNS)
            matrix += rows.swapaxes(1, 2) @ rows
            right -= (rows.swapaxes(1, 2) @ (residual * trust).reshape(len(points), -1, 1))[..., 0]
        return matrix, right

    def _prior(self, poses: CameraPoses) -> tuple[np.ndarray, np.ndarray]:
        precision = self.weights.prior * self.natural.precision
        matrix, right = np.zeros((len(poses.free), _UNKNOWNS, _UNKNOWNS)), np.zeros((len(poses.free), _UNKNOWNS))
        matrix[:, 6:, 6:] = precision
        right[:, 6:] = -(poses.free - self.natural.mean) @ precision
        return matrix, right

    def _residuals(self, points: np.ndarray, seen: Sighting2D) -> tuple[np.ndarray, np.ndarray]:
        """Of the picture [T, 21, 2] and of the world landmarks [T, 21, 3], in deviations; zero in unseen frames."""
        scale = (seen.is_seen / (self.weights.picture * seen.size))[:, None, None]
        depth = np.maximum(points[..., 2:], _LEAST_DEPTH_M)
        picture = (points[..., :2] / depth - seen.places) * scale
        centred = points - points.mean(1, keepdims=True)
        return picture, (centred - seen.world) / self._world_deviation() * seen.is_seen[:, None, None]

    def _slopes(self, points: np.ndarray, slopes: np.ndarray, seen: Sighting2D) -> tuple[np.ndarray, np.ndarray]:
        """Of both residuals: [T, 21, 2, 27] and [T, 21, 3, 27]."""
        scale = (seen.is_seen / (self.weights.picture * seen.size))[:, None, None, None]
        depth = np.maximum(points[..., 2], _LEAST_DEPTH_M)[..., None, None]
        picture = (slopes[..., :2, :] - points[..., :2, None] / depth * slopes[..., 2:, :]) / depth * scale
        centred = slopes - slopes.mean(1, keepdims=True)
        return picture, centred / self._world_deviation()[:, None] * seen.is_seen[:, None, None, None]

    def _world_deviation(self) -> np.ndarray:
        return np.array([self.weights.across_m, self.weights.across_m, self.weights.deep_m])

    def _accelerations(self, poses: CameraPoses) -> np.ndarray:
        """[T - 2, 27] second differences by the frames' times, in deviations."""
        if len(poses.wrist) < 3:
            return np.zeros((0, _UNKNOWNS))
        first, _, last = self._second_difference()
        turned = matrix_to_axis_angle(poses.root[1:] @ poses.root[:-1].swapaxes(1, 2))
        values = np.concatenate([poses.wrist, poses.free], 1)
        steps = np.concatenate([turned, np.diff(values, axis=0)], 1)
        return (last[:, None] * steps[1:] - first[:, None] * steps[:-1]) / self._smooth_deviation()

    def _add_smoothness(
        self, diagonal: np.ndarray, right: np.ndarray, poses: CameraPoses
    ) -> tuple[np.ndarray, np.ndarray]:
        """Add to the blocks in place; returns the ties to the next frame and the one after."""
        count = len(right)
        next_ties, second_ties = np.zeros((max(count - 1, 0), _UNKNOWNS)), np.zeros((max(count - 2, 0), _UNKNOWNS))
        residual = self._accelerations(poses)
        if not len(residual):
            return next_ties, second_ties
        first, middle, last = (part[:, None] / self._smooth_deviation() for part in self._second_difference())
        k = np.arange(_UNKNOWNS)
        for shift, slope in enumerate((first, middle, last)):
            frames = slice(shift, count - 2 + shift)
            diagonal[frames, k, k] += slope**2
            right[frames] -= slope * residual
        next_ties[: count - 2] += first * middle
        next_ties[1:] += middle * last
        second_ties += first * last
        return next_ties, second_ties

    def _second_difference(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients [T - 2] of three frames, per frame^2 at 30 a second."""
        steps = np.diff(self.sighting.times) * 30
        before, after = steps[:-1], steps[1:]
        first, last = 2 / (before * (before + after)), 2 / (after * (before + after))
        return first, -(first + last), last

    def _smooth_deviation(self) -> np.ndarray:
        w = self.weights
        return np.repeat([w.turn_rad, w.place_m, w.angle_rad], [3, 3, len(FREE)])

    def _parts(self, poses: CameraPoses):
        seen = self.sighting
        for first in range(0, len(poses.wrist), _FRAMES_AT_ONCE):
            frames = slice(first, first + _FRAMES_AT_ONCE)
            values = (seen.places, seen.world, seen.size, seen.is_seen, seen.times)
            yield CameraPoses(*(part[frames] for part in poses)), Sighting2D(*(value[frames] for value in values))


def at_nodes(landmarks: np.ndarray) -> np.ndarray:
    """[T, 21, ...] MediaPipe's landmarks in the order of the skeleton's nodes."""
    nodes = np.empty_like(landmarks)
    nodes[:, NODES_OF_LANDMARKS] = landmarks
    return nodes


def placed(points: np.ndarray, places: np.ndarray) -> np.ndarray:
    """[T, 3] m by which points [T, 21, 3] must move to be seen at places [T, 21, 2], by least squares.

    (x + X) = u (z + Z) is linear in the translation; dividing by the depth found makes it an error in the picture.
    """
    rows = np.zeros((*points.shape[:2], 2, 3))
    rows[..., 0, 0] = rows[..., 1, 1] = 1
    rows[..., 2] = -places
    right = places * points[..., 2:] - points[..., :2]
    weight, moved = np.ones(points.shape[:2]), np.zeros((len(points), 3))
    for _ in range(_PLACE_STEPS):
        weighted = (rows * weight[..., None, None]).reshape(len(points), -1, 3)
        normal = weighted.swapaxes(1, 2) @ rows.reshape(len(points), -1, 3) + 1e-9 * np.eye(3)
        moved = np.linalg.solve(normal, weighted.swapaxes(1, 2) @ right.reshape(len(points), -1, 1))[..., 0]
        depth = np.maximum(points[..., 2] + moved[:, None, 2], _LEAST_DEPTH_M)
        weight = 1 / depth**2
    return moved


def _nearest_seen(is_seen: np.ndarray) -> np.ndarray:
    """[T] index of the nearest frame with a hand."""
    seen = np.flatnonzero(is_seen)
    frames = np.arange(len(is_seen))
    after = np.clip(np.searchsorted(seen, frames), 0, len(seen) - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(seen[before] - frames) < np.abs(seen[after] - frames)
    return np.where(is_before, seen[before], seen[after])


def _huber(length: np.ndarray, limit: float) -> np.ndarray:
    return np.where(length <= limit, length**2, 2 * limit * length - limit**2)
