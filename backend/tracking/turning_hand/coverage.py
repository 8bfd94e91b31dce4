"""Which share of a hand's skin its pictures show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from ...geometry.rasterise import nearest_fronts, rasterise
from ...hand.lbs import posed_vertices
from ...hand.model import HandModel
from ...records.camera import Camera
from ...records.shot import HandPose

_LONGEST_PX = 160  # of the picture in which visibility is found
_LEAST_COSINE = 0.25  # between a face's normal and the view: flatter ones show no skin to speak of


def covered_share(poses: Sequence[HandPose], cameras: Sequence[Camera], model: HandModel) -> float:
    """Compute the share, by area, of a right hand's skin that at least one picture shows, arm and hidden parts aside.

    Args:
        poses: one a picture.
        cameras: one a picture, in the poses' world.
        model: the right hand's.
    """
    is_skin = model.framed_vertices[model.f].all(1)
    area = np.linalg.norm(_normals(model.v_template, model.f), axis=1)
    is_seen = np.zeros(len(model.f), bool)
    for pose, camera in zip(poses, cameras, strict=True):
        is_seen |= _visible_faces(posed_vertices(model, pose), model.f, camera)
    return float(area[is_seen & is_skin].sum() / area[is_skin].sum())


def _visible_faces(vertices: np.ndarray, faces: np.ndarray, camera: Camera) -> np.ndarray:
    small = camera.scaled(min(1.0, _LONGEST_PX / max(camera.size_px)))
    positions_px, depth = (torch.as_tensor(values) for values in small.project(vertices))
    found = np.zeros(len(faces), bool)
    fronts = nearest_fronts(rasterise(positions_px, depth, torch.as_tensor(faces), small.size_px), small.size_px)
    found[np.unique(fronts.face[fronts.face >= 0].numpy())] = True
    normals, to_camera = _normals(vertices, faces), camera.origin - vertices[faces].mean(1)
    cosine = (normals * to_camera).sum(1) / np.maximum(
        np.linalg.norm(normals, axis=1) * np.linalg.norm(to_camera, axis=1), 1e-12
    )
    around = np.isin(faces, np.unique(faces[found])).any(1)  # a face may lie between the pixels of a small picture
    return around & (cosine > _LEAST_COSINE)


def _normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return np.cross(b - a, c - a)
