"""Lays the built-in hand over another hand model at rest, so that both surfaces are one.

First by joints, then by pose and shape to closest points, then by moving every vertex as its neighbours move. What the
other model lacks, as the built-in hand's arm beyond an open wrist, moves along.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from scipy import sparse
from scipy.sparse.linalg import spsolve

from ...geometry.mesh_tables import area_weighted_normals, half_edges
from ...hand.lbs import SkinTensors, posed_vertices
from ...hand.model import HandModel
from ...motion.spaces import rest_wrists
from ...records.errors import LiveHandError
from ...records.shot import HandPose
from ..hand_from_mesh.hand_model import check_size
from ..natural_range import local_theta
from ..rest_alignment import HandAtRest, place_hand
from ..shape_fit import HandShape, fit_shape, rest_nodes
from .point_fit import FitPrior, PointGoals, fitted_to_points
from .region_mesh import NearestPoints, RegionMesh

_REACHES_MM = (15.0, 12.0, 9.0, 7.0, 5.0, 5.0, 4.0, 4.0)  # of closest points, round by round
_LEAST_AGREEMENT = 0.6  # cosine of both surfaces' normals
_END_M = 0.006  # before the other model's end, where its cap is
_PRIOR = FitPrior(joint_mm=2.0, theta_rad=0.08, beta=1.5, share=0.005)  # twists of round fingers are hardly told
_ACROSS = 0.3  # a closest point says little of where a vertex lies along the surface
_STIFFNESS = (30.0, 10.0, 3.0, 1.0)  # of the displacements' Laplacian against the points, round by round
_PULL = 1e-3  # of displacements towards none, where there are no points
_MOST_OFF_MM = 4.0  # median distance between the surfaces after the first fit


class Smoothness(NamedTuple):
    """How values of vertices keep to their neighbours' mean, and to zero, against their own weights."""

    stiffness: float
    decay: float


_OFFSET_SMOOTHNESS = Smoothness(0.5, 0.01)


@dataclass(frozen=True)
class Registration:
    """The built-in hand upon another model's template.

    Attributes:
        rest: pose and shape in which it comes nearest.
        conformed: [V, 3] m, its vertices moved onto the other's surface.
        points: of the other's surface, one for each of its vertices.
        weight: [V] 1 where both are one surface, 0 where the other has none.
    """

    rest: HandPose
    conformed: np.ndarray
    points: NearestPoints
    weight: np.ndarray


def registered(ours: HandModel, other: HandModel) -> Registration:
    """Lay our hand over another model's mean shape at rest; both of the same side.

    Raises:
        LiveHandError: it has not a hand's size, or the surfaces stay apart: it is no hand like ours.
    """
    check_size(other.joints)
    target = RegionMesh.of(other, other.v_template)
    rest = _fitted_rest(ours, other, target)
    vertices = posed_vertices(ours, rest)
    _check_near(ours, other, target, vertices)
    conformed = _conformed(ours, other, target, vertices)
    points, weight = _matched(ours, other, target, conformed, _REACHES_MM[-1])
    at = points.blended(target.vertices[target.faces])
    return Registration(rest, np.where(weight[:, None] > 0, at, conformed), points, weight)


def _fitted_rest(ours: HandModel, other: HandModel, target: RegionMesh) -> HandPose:
    """Fit pose and shape at rest, from where the joints are."""
    nodes = rest_nodes(other, np.zeros(10))
    shape = HandShape(fit_shape(ours, nodes).beta, 1.0)
    # Fingers that rest nearly straight do not tell the plane of their bend: they are turned the shortest way.
    hand = HandAtRest(HandAtRest.of(ours, shape).nodes, [None] * 5)
    rotations, wrist = place_hand(hand, nodes, np.full((5, 3), np.nan))
    theta = local_theta(rotations[None])[0]
    pose = HandPose(theta, shape.beta, wrist - rest_wrists(ours, shape.beta), ours.side)
    skin = SkinTensors.of(ours, dtype=torch.float64)
    for reach_mm in _REACHES_MM:
        vertices = posed_vertices(ours, pose)
        points, weight = _matched(ours, other, target, vertices, reach_mm)
        vertex = np.flatnonzero(weight)
        at = points.blended(target.vertices[target.faces])[vertex]
        normals = points.blended(target.normals[target.faces])[vertex]
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        off = np.linalg.norm(at - vertices[vertex], axis=1)
        robust = weight[vertex] / (1 + (off / (reach_mm * 3e-4)) ** 2)
        goals = PointGoals(vertex, at, normals, robust, _ACROSS, joints=other.joints)
        pose = fitted_to_points(skin, pose, goals, _PRIOR, steps=3)
    return pose


def _matched(
    ours: HandModel, other: HandModel, target: RegionMesh, vertices: np.ndarray, reach_mm: float
) -> tuple[NearestPoints, np.ndarray]:
    """Find the closest points of the other's surface, and (1) which [V] are the same part of the skin."""
    mesh = RegionMesh.of(ours, vertices)
    points = target.nearest(vertices, mesh.regions)
    normals = points.blended(target.normals[target.faces])
    agreement = (normals * mesh.normals).sum(1) / np.linalg.norm(normals, axis=1).clip(1e-9)
    is_near = (agreement > _LEAST_AGREEMENT) & (points.distance_m < reach_mm / 1000)
    return points, (is_near & ~_beyond_end(other, vertices)).astype(np.float64)


def _beyond_end(other: HandModel, vertices: np.ndarray) -> np.ndarray:
    """Tell which vertices [V] lie where the other model's wrist, or arm, has ended."""
    joints = other.joints
    elbow = (joints[0] - joints[4]) / np.linalg.norm(joints[0] - joints[4])
    return vertices @ elbow > (other.v_template @ elbow).max() - _END_M


def _check_near(ours: HandModel, other: HandModel, target: RegionMesh, vertices: np.ndarray) -> None:
    is_hand = ~_beyond_end(other, vertices) & ours.framed_vertices
    points = target.nearest(vertices[is_hand], RegionMesh.of(ours, vertices).regions[is_hand])
    off_mm = 1000 * float(np.median(points.distance_m))
    if not off_mm < _MOST_OFF_MM:
        raise LiveHandError(
            f"'{other.name}' must be a hand that the built-in one can be laid over, got surfaces {off_mm:.0f} mm "
            "apart; check that the file's unit is metres, and its side"
        )


def _conformed(ours: HandModel, other: HandModel, target: RegionMesh, vertices: np.ndarray) -> np.ndarray:
    """Move the vertices [V, 3] onto the other's surface, each about as its neighbours."""
    laplacian = _laplacian(ours)
    bending = sparse.kron(laplacian.T @ laplacian, sparse.eye(3)).tocsc()
    moved = vertices
    for stiffness in _STIFFNESS:
        points, weight = _matched(ours, other, target, moved, _REACHES_MM[-1])
        at = points.blended(target.vertices[target.faces])
        normals = area_weighted_normals(moved, ours.f)
        planes = normals[:, :, None] * normals[:, None] + _ACROSS**2 * np.eye(3)
        data = sparse.block_diag(list(weight[:, None, None] * planes)).tocsc()
        system = data + stiffness * bending + _PULL * sparse.eye(3 * len(vertices))
        goal = data @ (at - vertices).ravel()
        moved = vertices + np.asarray(spsolve(system.tocsc(), goal)).reshape(-1, 3)
    return moved


def smoothed(
    ours: HandModel, values: np.ndarray, weight: np.ndarray, smoothness: Smoothness = _OFFSET_SMOOTHNESS
) -> np.ndarray:
    """Smooth values [V] of vertices a little where they weigh [V], and let them die out where they do not."""
    laplacian = _laplacian(ours)
    bending, none = laplacian.T @ laplacian, sparse.eye(len(values))
    system = sparse.diags(weight) + smoothness.stiffness * bending + smoothness.decay * none
    return np.asarray(spsolve(system.tocsc(), weight * values))


def _laplacian(model: HandModel) -> sparse.csr_matrix:
    """Return [V, V]: a vertex less the mean of its neighbours."""
    edges, count = half_edges(model.f), len(model.v_template)
    pairs = np.concatenate([edges, edges[:, ::-1]])
    neighbours = sparse.coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count)).tocsr()
    neighbours.data[:] = 1
    return sparse.eye(count) - sparse.diags(1 / np.asarray(neighbours.sum(1))[:, 0]) @ neighbours
