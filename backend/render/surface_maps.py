"""Meshes as each pixel sees them: the hand's normal, atlas coordinates, position and fade, and the scene's depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch

from ..field.rays import camera_tensors, project, ray_directions, ray_origins
from ..geometry.mesh import vertex_normals
from ..geometry.rasterise import Fragments, rasterise
from ..hand.arm_end import distance_from_end_m, opaque_share
from ..hand.model import HandModel
from ..records.camera import Camera
from ..records.frame import DEPTH_BACKGROUND
from ..records.shot import Shot


@dataclass(frozen=True)
class SurfaceMaps:
    """The mesh's nearest front face at every pixel centre; zero beside the mesh.

    Attributes:
        depth: [H, W] m along the optical axis; `DEPTH_BACKGROUND` beside the mesh.
        normal: [H, W, 3] smooth, unit length, world.
        uv: [H, W, 3] atlas u and v, and 1 on the mesh.
        position: [H, W, 3] world, m.
        motion: [H, W, 4] px, right and up: from the place in the frame to that one frame before, and from the place
            one frame later to that in the frame; zero if it is not known.
        fade: [H, W, 1] what the wrist's fade leaves, 0 to 1.
    """

    depth: np.ndarray
    normal: np.ndarray
    uv: np.ndarray
    position: np.ndarray
    motion: np.ndarray
    fade: np.ndarray


def surface_maps(shot: Shot, hand: HandModel, motion: np.ndarray | None = None) -> SurfaceMaps:
    """Rasterise the shot's mesh.

    Args:
        shot: a hand in view.
        hand: its model, of either side.
        motion: [V, 4] px, of the vertices; None: not known.
    """
    if motion is None:
        motion = np.zeros((len(shot.vertices), 4))
    hand = hand.for_side(shot.pose.side)
    vertices, faces = torch.as_tensor(shot.vertices, dtype=torch.float32), torch.as_tensor(hand.f)
    seen, size_px = _VisiblePoints.of(shot, vertices, faces), shot.camera.size_px
    corners = faces[seen.face]
    normals = _blend(seen.weights, vertex_normals(vertices, faces)[corners])
    uv = _blend(seen.weights, torch.as_tensor(hand.vt[hand.ft], dtype=torch.float32)[seen.face])
    fade = torch.as_tensor(opaque_share(distance_from_end_m(hand), shot.wrist_fade_m), dtype=torch.float32)
    return SurfaceMaps(
        _image(seen.depth[:, None], seen.pixel, size_px, DEPTH_BACKGROUND)[..., 0],
        _image(torch.nn.functional.normalize(normals, dim=-1), seen.pixel, size_px),
        _image(torch.cat([uv, torch.ones(len(uv), 1)], 1), seen.pixel, size_px),
        _image(seen.points, seen.pixel, size_px),
        _image(_blend(seen.weights, torch.as_tensor(motion, dtype=torch.float32)[corners]), seen.pixel, size_px),
        _image(_blend(seen.weights, fade[corners][..., None]), seen.pixel, size_px),
    )


def vertex_map(shot: Shot, hand: HandModel, values: np.ndarray) -> np.ndarray:
    """Interpolate vertex values [V] at pixel centres [H, W], on the mesh's nearest front face; NaN beside it."""
    vertices = torch.as_tensor(shot.vertices, dtype=torch.float32)
    faces = torch.as_tensor(hand.for_side(shot.pose.side).f)
    seen = _VisiblePoints.of(shot, vertices, faces)
    of_corners = torch.as_tensor(values, dtype=torch.float32)[faces[seen.face]][..., None]
    return _image(_blend(seen.weights, of_corners), seen.pixel, shot.camera.size_px, np.nan)[..., 0]


def nearest_maps(maps: list[SurfaceMaps]) -> SurfaceMaps:
    """Merge the maps of several hands by depth."""
    first, *others = maps
    for other in others:
        is_nearer = other.depth < first.depth
        mixed = ("normal", "uv", "position", "motion", "fade")
        pairs = ((getattr(first, name), getattr(other, name)) for name in mixed)
        merged = (np.where(is_nearer[..., None], theirs, ours) for ours, theirs in pairs)
        first = SurfaceMaps(np.minimum(first.depth, other.depth), *merged)
    return first


class _VisiblePoints(NamedTuple):
    """What K pixels see of a mesh: indices of pixel and face, depth in m, points [K, 3] in the world, barycentric."""

    pixel: torch.Tensor
    face: torch.Tensor
    depth: torch.Tensor
    points: torch.Tensor
    weights: torch.Tensor

    @classmethod
    def of(cls, shot: Shot, vertices: torch.Tensor, faces: torch.Tensor) -> _VisiblePoints:
        view = camera_tensors(shot.camera, "cpu")
        hits = rasterise(*project(view, vertices), faces, view.size_px, view.is_orthographic)
        pixel, hit = _nearest_fronts(hits)
        depth, face = hits.depth[hit], hits.face[hit]
        points = ray_origins(view, pixel) + depth[:, None] * ray_directions(view, pixel)
        return cls(pixel, face, depth, points, _barycentric(points, vertices[faces[face]]))


def _nearest_fronts(hits: Fragments) -> tuple[torch.Tensor, torch.Tensor]:
    """Find pixels that see a front face, and the fragment that each sees."""
    fronts = hits.is_front.nonzero()[:, 0].numpy()
    order = fronts[np.lexsort((hits.depth[fronts], hits.pixel[fronts]))]
    pixel, first = np.unique(hits.pixel[order].numpy(), return_index=True)
    return torch.as_tensor(pixel), torch.as_tensor(order[first])


def _barycentric(points: torch.Tensor, corners: torch.Tensor) -> torch.Tensor:
    """Compute the barycentric coordinates [K, 3] of points in the planes of triangles [K, 3, 3]."""
    a, b, c = corners.unbind(1)
    normal = torch.linalg.cross(b - a, c - a)
    squared = (normal * normal).sum(-1)
    of_b = (torch.linalg.cross(points - a, c - a) * normal).sum(-1) / squared
    of_c = (torch.linalg.cross(b - a, points - a) * normal).sum(-1) / squared
    return torch.stack([1 - of_b - of_c, of_b, of_c], -1)


def _blend(weights: torch.Tensor, corners: torch.Tensor) -> torch.Tensor:
    return (weights[..., None] * corners).sum(1)


def _image(values: torch.Tensor, pixel: torch.Tensor, size_px: tuple[int, int], empty: float = 0.0) -> np.ndarray:
    width, height = size_px
    image = torch.full((height * width, values.shape[1]), empty)
    image[pixel] = values
    return image.reshape(height, width, -1).numpy()


def scene_depth(triangles: np.ndarray, camera: Camera) -> np.ndarray:
    """Rasterise the depth [H, W], m along the optical axis; `DEPTH_BACKGROUND` where there is nothing.

    Args:
        triangles: [T, 3, 3] in the world, m, all before the camera.
        camera: of the image.
    """
    width, height = camera.size_px
    nearest = torch.full((height * width,), DEPTH_BACKGROUND)
    if len(triangles):
        view = camera_tensors(camera, "cpu")
        corners = torch.as_tensor(triangles.reshape(-1, 3), dtype=torch.float32)
        faces = torch.arange(len(corners)).reshape(-1, 3)
        hits = rasterise(*project(view, corners), faces, view.size_px, view.is_orthographic)
        nearest.scatter_reduce_(0, hits.pixel.long(), hits.depth.float(), "amin")
    return nearest.reshape(height, width).numpy()
