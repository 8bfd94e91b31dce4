"""Fits all frames of a take at once to landmarks in the picture, through its camera.

A maximum a posteriori estimate. Lifted landmarks give each joint's position in the picture, with a robust error, and
each free angle, both with deviations of their own. Free angles have the distribution of natural poses besides, and
hard limits; angles, rotation and position accelerate little, by the frames' true times. Every step solves all frames
together (Gauss-Newton). Frames without landmarks follow from their neighbours.

Axes are the camera's (OpenCV's), whose optical centre is the origin; points in the picture are divided by the focal
length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ...hand.joint_limits import FREE
from .articulation import NaturalPoses, all_angles, within_limits
from .initial_pose import aligned_bones, aligned_palm
from .lifting import LiftedLandmarks
from .skeleton import NODES_OF_LANDMARKS, HandSkeleton, PosedSkeleton, node_jacobian


def solve_pentadiagonal(
    diagonal: np.ndarray, next_ties: np.ndarray, second_ties: np.ndarray, right: np.ndarray
) -> np.ndarray:
    """Solve for [T, n] by block elimination, two frames at a time.

    Args:
        diagonal: [T, n, n] blocks of each frame.
        next_ties: [T - 1, n] diagonals of the blocks above them, between each frame and the next.
        second_ties: [T - 2, n] the same between each frame and the one after next.
        right: [T, n].

    Raises:
        numpy.linalg.LinAlgError: the matrix is singular.
    """
    count, n = right.shape
    pairs = (count + 1) // 2
    k = np.arange(n)
    blocks = np.zeros((pairs, 2 * n, 2 * n))
    blocks[:, k, k] = blocks[:, n + k, n + k] = 1  # for the frame that an odd count lacks
    blocks[:, :n, :n] = diagonal[::2]
    blocks[: count // 2, n:, n:] = diagonal[1::2]
    inner = next_ties[::2]
    blocks[: len(inner), k, n + k] = blocks[: len(inner), n + k, k] = inner
    ties = np.zeros((max(pairs - 1, 0), 2 * n, 2 * n))
    ties[: len(next_ties[1::2]), n + k[:, None], k[:, None]] = next_ties[1::2, :, None]
    ties[: len(second_ties[::2]), k[:, None], k[:, None]] = second_ties[::2, :, None]
    ties[: len(second_ties[1::2]), n + k[:, None], n + k[:, None]] = second_ties[1::2, :, None]
    wanted = np.zeros((pairs, 2 * n))
    wanted[:, :n] = right[::2]
    wanted[: count // 2, n:] = right[1::2]
    return _solve_tridiagonal(blocks, ties, wanted).reshape(2 * pairs, n)[:count]


def _solve_tridiagonal(blocks: np.ndarray, ties: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve for [P, m] with blocks [P, m, m] and the ties [P - 1, m, m] above them."""
    eliminated = np.empty((*right.shape, ties.shape[-1] + 1 if len(ties) else 1))
    block, rest = blocks[0], right[0]
    for index in range(len(blocks)):
        if index:
            above = ties[index - 1]
            block = blocks[index] - above.T @ eliminated[index - 1, :, 1:]
            rest = right[index] - above.T @ eliminated[index - 1, :, 0]
        columns = np.column_stack([rest, ties[index]]) if index < len(ties) else rest[:, None]
        eliminated[index, :, : columns.shape[1]] = np.linalg.solve(block, columns)
    solution = np.empty_like(right)
    solution[-1] = eliminated[-1, :, 0]
    for index in range(len(blocks) - 2, -1, -1):
        solution[index] = eliminated[index, :, 0] - eliminated[index, :, 1:] @ solution[index + 1]
    return solution


_COLUMNS = np.concatenate([np.arange(6), 6 + FREE])
_UNKNOWNS = len(_COLUMNS)
_FRAMES_AT_ONCE = 256  # bounds memory
_PLACE_STEPS = 3
_LEAST_DEPTH_M = 0.02
_LEAST_GAIN = 1e-4  # relative, of the cost; a smaller one ends the fit


class FitWeights(NamedTuple):
    """What a fit trusts besides the landmarks.

    Attributes:
        huber: residual, in deviations, from which a landmark counts less.
        prior: weight of natural poses.
        angle_rad, turn_rad, place_m: deviations of the acceleration of angles, wrist's rotation and place, per frame^2
            at 30 a second.
    """

    huber: float = 2.0
    prior: float = 1.0
    angle_rad: float = 0.05
    turn_rad: float = 0.03
    place_m: float = 0.004


class CameraPoses(NamedTuple):
    """T poses: root [T, 3, 3], wrist [T, 3] m, free angles [T, 21]."""

    root: np.ndarray
    wrist: np.ndarray
    free: np.ndarray

    def stepped(self, step: np.ndarray) -> CameraPoses:
        """Take a step [T, 27] of rotation, place and angles, within the limits."""
        root = axis_angle_to_matrix(step[:, :3]) @ self.root
        return CameraPoses(root, self.wrist + step[:, 3:6], within_limits(self.free + step[:, 6:]))


@dataclass(frozen=True)
class Sighting2D:
    """A right hand's lifted landmarks in T frames of one camera; of frames without the hand, anything.

    Attributes:
        lifted: at the skeleton's nodes.
        world: [T, 21, 3] m about their centre, of the size of the skeleton.
        size: [T] of the hand, divided by the focal length as its points are.
        is_seen: [T].
        times: [T] s, increasing.
    """

    lifted: LiftedLandmarks
    world: np.ndarray
    size: np.ndarray
    is_seen: np.ndarray
    times: np.ndarray

    def part(self, frames: slice) -> Sighting2D:
        """Cut out some of the frames."""
        lifted = LiftedLandmarks(*(value[frames] for value in self.lifted))
        rest = (self.world, self.size, self.is_seen, self.times)
        return Sighting2D(lifted, *(value[frames] for value in rest))


@dataclass(frozen=True)
class CameraProblem:
    """The poses of one hand of known shape that explain a take."""

    sighting: Sighting2D
    skeleton: HandSkeleton
    offsets: np.ndarray
    natural: NaturalPoses
    weights: FitWeights

    def initial(self) -> CameraPoses:
        """Place the world landmarks' poses in closed form where the picture shows them, linearly in time in gaps."""
        seen = self.sighting
        rest = np.concatenate([np.zeros((1, 3)), np.cumsum(self.offsets, 1).reshape(20, 3)])
        root, _ = aligned_palm(seen.world, rest)
        free = within_limits(aligned_bones(seen.world, root, self.skeleton, np.zeros(10)))
        wrist = np.zeros((len(root), 3))
        poses = CameraPoses(root, wrist, free)
        wrist = placed(self.posed(poses).nodes, seen.lifted.picture_points)
        nearest = _nearest_visible(seen.is_seen)
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
        """Put the skeleton into the poses."""
        return self.skeleton.pose(poses.root, poses.wrist, all_angles(poses.free), self.offsets)

    def cost(self, poses: CameraPoses) -> float:
        """Compute twice the negative logarithm of the posterior, but for a constant."""
        total = 0.0
        for part, seen in self._parts(poses):
            picture = self._residuals(self.posed(part).nodes, seen)
            total += float((_huber(np.linalg.norm(picture, axis=-1), self.weights.huber)).sum())
            off = part.free - self.natural.mean
            total += self.weights.prior * float(((off @ self.natural.precision) * off).sum())
            total += float(((part.free - seen.lifted.free) ** 2 * _angle_precision(seen)).sum())
        return total + float((self._accelerations(poses) ** 2).sum())

    def reprojection(self, poses: CameraPoses) -> np.ndarray:
        """Measure the root mean square distance [T] of the landmarks in the picture from the hand's, over its size."""
        found = []
        for part, seen in self._parts(poses):
            nodes = self.posed(part).nodes
            off = nodes[..., :2] / nodes[..., 2:] - seen.lifted.picture_points
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
        """Build the normal equations [T, 27, 27] and [T, 27] of each frame alone."""
        posed = self.posed(poses)
        slopes = self._slopes(posed.nodes, node_jacobian(posed)[..., _COLUMNS], seen)
        residual = self._residuals(posed.nodes, seen)
        length = np.linalg.norm(residual, axis=-1)
        trust = np.sqrt(np.minimum(1, self.weights.huber / np.maximum(length, 1e-12)))[..., None]
        rows = (slopes * trust[..., None]).reshape(len(residual), -1, _UNKNOWNS)
        matrix = rows.swapaxes(1, 2) @ rows
        right = -(rows.swapaxes(1, 2) @ (residual * trust).reshape(len(residual), -1, 1))[..., 0]
        self._add_angles(matrix, right, poses, seen)
        return matrix, right

    def _add_angles(self, matrix: np.ndarray, right: np.ndarray, poses: CameraPoses, seen: Sighting2D) -> None:
        """Add natural poses and the lifted angles, in place."""
        natural, lifted = self.weights.prior * self.natural.precision, _angle_precision(seen)
        matrix[:, 6:, 6:] += natural
        right[:, 6:] -= (poses.free - self.natural.mean) @ natural
        k = np.arange(6, _UNKNOWNS)
        matrix[:, k, k] += lifted
        right[:, 6:] -= (poses.free - seen.lifted.free) * lifted

    def _residuals(self, nodes: np.ndarray, seen: Sighting2D) -> np.ndarray:
        """Compute the residuals [T, 21, 2] of the points in the picture, in deviations; zero in unseen frames."""
        depth = np.maximum(nodes[..., 2:], _LEAST_DEPTH_M)
        return (nodes[..., :2] / depth - seen.lifted.picture_points) * _point_precision(seen)[..., None]

    def _slopes(self, nodes: np.ndarray, slopes: np.ndarray, seen: Sighting2D) -> np.ndarray:
        """Compute the slopes [T, 21, 2, 27] of these residuals, from the nodes' own [T, 21, 3, 27]."""
        depth = np.maximum(nodes[..., 2], _LEAST_DEPTH_M)[..., None, None]
        across = slopes[..., :2, :] - nodes[..., :2, None] / depth * slopes[..., 2:, :]
        return across / depth * _point_precision(seen)[..., None, None]

    def _accelerations(self, poses: CameraPoses) -> np.ndarray:
        """Compute [T - 2, 27] second differences by the frames' times, in deviations."""
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
        """Compute coefficients [T - 2] of three frames, per frame^2 at 30 a second."""
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
            yield CameraPoses(*(part[frames] for part in poses)), seen.part(frames)


def at_nodes(landmarks: np.ndarray) -> np.ndarray:
    """Return [T, 21, ...] MediaPipe's landmarks in the order of the skeleton's nodes."""
    nodes = np.empty_like(landmarks)
    nodes[:, NODES_OF_LANDMARKS] = landmarks
    return nodes


def placed(points: np.ndarray, picture_points: np.ndarray) -> np.ndarray:
    """Find by how much [T, 3] m points [T, 21, 3] must move to be seen at points [T, 21, 2], by least squares.

    (x + X) = u (z + Z) is linear in the translation; dividing by the depth found makes it an error in the picture.
    """
    rows = np.zeros((*points.shape[:2], 2, 3))
    rows[..., 0, 0] = rows[..., 1, 1] = 1
    rows[..., 2] = -picture_points
    right = picture_points * points[..., 2:] - points[..., :2]
    weight, moved = np.ones(points.shape[:2]), np.zeros((len(points), 3))
    for _ in range(_PLACE_STEPS):
        weighted = (rows * weight[..., None, None]).reshape(len(points), -1, 3)
        normal = weighted.swapaxes(1, 2) @ rows.reshape(len(points), -1, 3) + 1e-9 * np.eye(3)
        moved = np.linalg.solve(normal, weighted.swapaxes(1, 2) @ right.reshape(len(points), -1, 1))[..., 0]
        depth = np.maximum(points[..., 2] + moved[:, None, 2], _LEAST_DEPTH_M)
        weight = 1 / depth**2
    return moved


def _point_precision(seen: Sighting2D) -> np.ndarray:
    """Compute [T, 21] one over the deviations of the points; zero in unseen frames."""
    return seen.is_seen[:, None] / seen.lifted.points_sd


def _angle_precision(seen: Sighting2D) -> np.ndarray:
    """Compute [T, 21] one over the variances of free angles; zero in unseen frames."""
    return seen.is_seen[:, None] / seen.lifted.free_sd**2


def _nearest_visible(is_seen: np.ndarray) -> np.ndarray:
    """Find the index [T] of the nearest frame with a hand."""
    seen = np.flatnonzero(is_seen)
    frames = np.arange(len(is_seen))
    after = np.clip(np.searchsorted(seen, frames), 0, len(seen) - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(seen[before] - frames) < np.abs(seen[after] - frames)
    return np.where(is_before, seen[before], seen[after])


def _huber(length: np.ndarray, limit: float) -> np.ndarray:
    return np.where(length <= limit, length**2, 2 * limit * length - limit**2)
