"""Flat Gaussians on the surface of a posed hand, without colours."""

from __future__ import annotations

import numpy as np

from ...geometry.mesh_tables import area_weighted_normals
from ...geometry.rotation import matrix_to_quaternion
from ...geometry.spread_points import SpreadPoints, spread_points
from ...records.errors import LiveHandError
from ...records.shot import Shot
from ..albedo import atlas_albedo
from ..frame_task import HandRenderer
from ..relightable import RelightablePipeline
from ..renderer import Renderer
from .gaussians import Splats

_WIDTH, _THICKNESS = 0.8, 0.08  # of the distance between neighbours
_OPACITY = 0.98
_INWARD = 0.45  # of the distance between neighbours: else outlines, where many overlap, would stand out
_ALBEDO_PX = 1024


class SplatGround:
    """The surface of a hand as a renderer shows it, with points on it that stay where they are on the skin.

    Args:
        renderer: of the hand.
        shot: in whose pose the points are spread evenly.
        count: about how many points.

    Raises:
        LiveHandError: the avatar is not relightable.
    """

    def __init__(self, renderer: HandRenderer, shot: Shot, count: int):
        if not isinstance(renderer, Renderer) or not isinstance(pipeline := renderer.pipeline, RelightablePipeline):
            raise LiveHandError(
                f"splats need a relightable avatar, '{renderer.avatar.name}' is lit by its capture; choose another"
            )
        side = shot.pose.side
        model = renderer.hand.for_side(side)
        self._renderer, self._faces, corner_uv = renderer, model.f, model.vt[model.ft]
        if pipeline.surface is not None:
            template = pipeline.surface.levels(side).finest
            self._faces, corner_uv = template.faces.cpu().numpy(), template.corner_uv.cpu().numpy()
        self.points: SpreadPoints = spread_points(self._vertices(shot), self._faces, count)
        atlas = atlas_albedo(renderer.avatar, renderer.hand.for_side("right"), _ALBEDO_PX, side)
        column, row = (self.points.at(corner_uv) * _ALBEDO_PX).astype(int).clip(0, _ALBEDO_PX - 1).T
        self._albedo = atlas[row, column]

    def flat_splats(self, shot: Shot, axes: np.ndarray) -> Splats:
        """Lay grey Gaussians onto the surface of a shot; `axes` [3, 3] rotates the world to those of the splats."""
        vertices = self._vertices(shot)
        corner_normals = area_weighted_normals(vertices, self._faces)[self._faces]
        normals = _unit(self.points.at(corner_normals)) @ axes.T
        spacing_m = self.points.spacing_m
        count = len(normals)
        return Splats(
            positions=self.points.at(vertices[self._faces]) @ axes.T - _INWARD * spacing_m * normals,
            rotations=matrix_to_quaternion(_frames(normals)),
            scales=np.tile(spacing_m * np.array([_WIDTH, _WIDTH, _THICKNESS]), (count, 1)),
            opacity=np.full(count, _OPACITY),
            harmonics=np.zeros((count, 1, 3)),
            normals=normals,
            albedo=self._albedo,
        )

    def _vertices(self, shot: Shot) -> np.ndarray:
        fine = self._renderer.posed_surface(shot)
        return np.asarray(shot.vertices if fine is None else fine.vertices, np.float64)


def _frames(normals: np.ndarray) -> np.ndarray:
    """Build rotations [N, 3, 3] whose third axes are the normals [N, 3]."""
    beside = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = _unit(np.cross(beside, normals))
    return np.stack([first, np.cross(normals, first), normals], 2)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
