"""A hand model of MANO's format and size that is ours: another mesh, rest pose, shapes and weights, all known.

778 of the built-in hand's vertices without its arm, open at the wrist, as MANO is. It rests in another pose and shape,
with bumps that no beta gives; its shapes are mixed, its joints a little elsewhere, its weights softer.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from livehand.backend.geometry.mesh_tables import area_weighted_normals, half_edges, open_half_edges
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_arrays, posed_vertices
from livehand.backend.hand.model import PARENTS, HandModel
from livehand.backend.hand.model_file import load_default_hand, load_hand_model
from livehand.backend.records.shot import HandPose
from livehand.backend.rigs.hand_from_mesh.hand_model import joint_regressor

VERTICES = 778
_REST_DEG = (8.0, 4.0, 1.5)  # of flexion, abduction and twist, from the built-in hand's rest
_WRIST_M = 0.012  # of the arm that is kept, beyond the wrist's joint


@dataclass(frozen=True)
class ManoTwin:
    """The model, and what is known of it.

    Attributes:
        model: right.
        hands_mean: [15, 3] of its file.
        vertex: [778] of the built-in hand, each of its vertices'.
        rest: the built-in hand's pose and shape in which the twin rests, but for the bumps.
        mixed: [10, 10]: the built-in hand's beta is that of rest and this times the twin's.
        surface: [V, 3] where all of the built-in hand's vertices are on the twin at rest.
    """

    model: HandModel
    hands_mean: np.ndarray
    vertex: np.ndarray
    rest: HandPose
    mixed: np.ndarray
    surface: np.ndarray


def write_twin(path, bump_mm=1.2):
    """Write the twin's file, and return what is known of it."""
    ours, rng = load_default_hand(), np.random.default_rng(5)
    theta = theta_of(rng.normal(size=(15, 3)) * _REST_DEG, FingerAxes.of_default_hand())
    rest = HandPose(theta, rng.normal(0, 0.7, 10), np.array([0.004, -0.006, 0.003]))
    mixed, _ = np.linalg.qr(rng.normal(size=(10, 10)))
    surface = _bumped(posed_vertices(ours, rest), ours.f, bump_mm)
    vertex, faces = _thinned(ours, surface)
    step = 1e-4
    directions = [posed_vertices(ours, _shaped(rest, step * mixed[:, k])) for k in range(10)]
    shapedirs = (np.stack(directions, -1) - posed_vertices(ours, rest)[..., None]) / step
    joints = posed_arrays(ours, rest)[1] + rng.normal(0, 0.001, (16, 3))
    weights = ours.lbs_weights[vertex] ** 0.8
    parents = np.array(PARENTS)
    mean = rng.normal(0, 0.15, (15, 3))
    arrays = {
        "v_template": surface[vertex],
        "f": faces,
        "weights": weights / weights.sum(1, keepdims=True),
        "J_regressor": joint_regressor(surface[vertex], joints),
        "kintree_table": np.stack([np.where(parents < 0, 2**32 - 1, parents), np.arange(16)]),
        "shapedirs": shapedirs[vertex],
        "posedirs": 0.7 * ours.posedirs[vertex],
        "hands_mean": mean.ravel(),
    }
    np.savez(path, **arrays)
    return ManoTwin(load_hand_model(path), mean, vertex, rest, mixed, surface)


def _shaped(pose, beta):
    return HandPose(pose.theta, pose.beta + beta, pose.transl)


def _bumped(vertices, faces, bump_mm):
    waves = np.sin(vertices @ np.array([[130.0, 60, -40], [-50, 140, 90], [70, -80, 150]])).mean(1)
    return vertices + 1e-3 * bump_mm * waves[:, None] * area_weighted_normals(vertices, faces)


def _thinned(ours, surface):
    """The kept vertices of the hand without its arm, and its faces in their numbers, by collapsing short edges."""
    elbow = (ours.joints[0] - ours.joints[4]) / np.linalg.norm(ours.joints[0] - ours.joints[4])
    is_hand = (ours.v_template - ours.joints[0]) @ elbow < _WRIST_M
    faces = ours.f[is_hand[ours.f].all(1)]
    fixed = set(np.unique(open_half_edges(faces)).tolist())
    around = {int(v): set() for v in np.unique(faces)}
    triangles = {index: [int(v) for v in face] for index, face in enumerate(faces)}
    for index, face in triangles.items():
        for v in face:
            around[v].add(index)
    length = lambda a, b: float(np.linalg.norm(surface[a] - surface[b]))  # noqa: E731
    heap = [(length(a, b), int(a), int(b)) for a, b in half_edges(faces)]
    heapq.heapify(heap)
    while len(around) > VERTICES:
        _, gone, kept = heapq.heappop(heap)
        if gone in fixed or gone not in around or kept not in around:
            continue
        if not _may_collapse(gone, kept, around, triangles, surface):
            continue
        for index in list(around[gone]):
            face = triangles[index]
            if kept in face:
                for v in face:
                    around[v].discard(index)
                del triangles[index]
            else:
                face[face.index(gone)] = kept
                around[kept].add(index)
        del around[gone]
        for v in _neighbours(kept, around, triangles):
            heapq.heappush(heap, (length(kept, v), kept, v))
            heapq.heappush(heap, (length(kept, v), v, kept))
    vertex = np.array(sorted(around))
    return vertex, np.searchsorted(vertex, np.array(list(triangles.values())))


def _neighbours(vertex, around, triangles):
    return {v for index in around[vertex] for v in triangles[index]} - {vertex}


def _may_collapse(gone, kept, around, triangles, surface):
    """Whether the surface stays a surface, and none of its faces turns over."""
    shared = _neighbours(gone, around, triangles) & _neighbours(kept, around, triangles)
    if len(shared) != 2 or kept not in _neighbours(gone, around, triangles):
        return False
    for index in around[gone]:
        face = triangles[index]
        if kept in face:
            continue
        before, after = (_normal(surface[f]) for f in (face, [kept if v == gone else v for v in face]))
        if before @ after < 0.6 * np.linalg.norm(before) * np.linalg.norm(after):
            return False
    return True


def _normal(corners):
    return np.cross(corners[1] - corners[0], corners[2] - corners[0])
