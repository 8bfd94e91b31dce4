"""A static texture on the hand's atlas: filled from pictures of the posed mesh, and drawn on it again.

The texture [N, N, 3] is sRGB-encoded and straight; texel (row v, column u) has its centre at (i + 0.5) / N, as the
feature planes'. Pictures are [4, H, W], encoded colour times alpha, and alpha.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.ndimage import distance_transform_edt
from scipy.spatial import KDTree
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample

from ...field.rays import CameraTensors, project, ray_origin
from ...geometry.mesh import PosedMesh, Topology
from ...geometry.rasterise import rasterise
from ...geometry.uvh import SurfaceSamples, atlas_uv, interpolate
from .drawing import depth_map, drawn_surface, nearest_of_each

RESOLUTION = 1024
DILATION_TEXELS = 4
_VISIBLE_M = 0.001  # in front of the rasterised surface's back
_MIN_COSINE = 0.2
_OPAQUE = 0.99
_FILL_POINTS = 20_000  # seen texels, a millimetre apart, that holes are filled from: with all it takes minutes
_DEPTH_FINER = 4  # depth is compared at this many times the picture's resolution: skin slopes within a pixel


class Texels(NamedTuple):
    """The texels of the charts.

    Attributes:
        texel: [T] row * N + column.
        samples: the surface point of each.
        resolution: N.
    """

    texel: Tensor
    samples: SurfaceSamples
    resolution: int


def texels_of(topology: Topology, resolution: int = RESOLUTION) -> Texels:
    """Select the texels whose centres lie in a chart of the atlas."""
    device, faces = topology.faces.device, len(topology.faces)
    corners = topology.corner_uv * resolution
    index = torch.arange(3 * faces, device=device).reshape(faces, 3)
    flat = torch.ones(3 * faces, device=device)
    fragments = rasterise(corners.reshape(-1, 2), flat, index, (resolution, resolution))
    chosen = nearest_of_each(fragments.pixel, fragments.face.to(flat.dtype))
    texel, face = fragments.pixel[chosen], fragments.face[chosen]
    centre = torch.stack([texel % resolution, texel // resolution], -1) + 0.5
    samples = SurfaceSamples(face, _barycentric_2d(centre, corners[face]), torch.zeros(len(face), device=device))
    return Texels(texel, samples, resolution)


@dataclass
class TextureSum:
    """The weighted sum of what pictures show of every texel.

    Attributes:
        texels: of the charts.
        topology: of the hand.
    """

    texels: Texels
    topology: Topology

    def __post_init__(self):
        self._colour = torch.zeros(len(self.texels.texel), 3, device=self.texels.texel.device)
        self._weight = torch.zeros(len(self.texels.texel), device=self.texels.texel.device)

    def add(self, picture: Float[Tensor, "4 H W"], mesh: PosedMesh, camera: CameraTensors) -> None:
        """Add a picture of a pose; weights are (n.v)^2 times the pixels that a texel covers."""
        samples = self.texels.samples
        points = interpolate(mesh.vertices, self.topology, samples)
        normals = torch.nn.functional.normalize(interpolate(mesh.normals, self.topology, samples), dim=-1)
        towards = torch.nn.functional.normalize(ray_origin(camera) - points, dim=-1)
        cosine = (normals * towards).sum(-1)
        positions_px, depth = project(camera, points)
        rgba = sampled(picture, positions_px / torch.tensor(camera.size_px, device=points.device))
        is_seen = (cosine > _MIN_COSINE) & (rgba[:, 3] > _OPAQUE)
        is_seen &= self._is_front(mesh, camera, positions_px, depth)
        pixels = (camera.focal_px / depth) ** 2 * cosine * self._area_m2(mesh)
        weight = torch.where(is_seen, cosine**2 * pixels, torch.zeros_like(depth))
        self._colour += weight[:, None] * rgba[:, :3] / rgba[:, 3:].clamp(min=_OPAQUE)
        self._weight += weight

    def _is_front(self, mesh: PosedMesh, camera: CameraTensors, positions_px: Tensor, depth: Tensor) -> Tensor:
        """Tell whether nothing lies before the texel."""
        finer = _scaled(camera, _DEPTH_FINER)
        nearest = depth_map(drawn_surface(mesh, self.topology, finer), finer.size_px)
        column, row = (positions_px * _DEPTH_FINER).long().unbind(-1)
        width, height = finer.size_px
        is_inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        found = nearest[row.clamp(0, height - 1), column.clamp(0, width - 1)]
        return is_inside & (depth <= found + _VISIBLE_M) & found.isfinite()

    def _area_m2(self, mesh: PosedMesh) -> Float[Tensor, " T"]:
        """Measure the area on the skin that a texel covers."""
        a, b, c = mesh.vertices[self.topology.faces].unbind(1)
        area = torch.linalg.cross(b - a, c - a).norm(dim=-1)
        uv_a, uv_b, uv_c = self.topology.corner_uv.unbind(1)
        first, second = uv_b - uv_a, uv_c - uv_a
        in_atlas = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).abs()
        return (area / in_atlas.clamp(min=1e-12))[self.texels.samples.face] / self.texels.resolution**2

    def finished(self, template: Float[Tensor, "V 3"]) -> tuple[Float[Tensor, "N N 3"], float]:
        """Fill the texture from the nearest seen skin where no picture saw it, and tell that share of the charts."""
        is_seen = self._weight > 0
        colour = self._colour / self._weight.clamp(min=1e-12)[:, None]
        filled = 1 - float(is_seen.float().mean())
        if 0 < filled < 1:
            positions = interpolate(template, self.topology, self.texels.samples).cpu().numpy()
            seen = is_seen.cpu().numpy()
            known = np.flatnonzero(seen)
            known = known[:: -(-len(known) // _FILL_POINTS)]
            _, nearest = KDTree(positions[known]).query(positions[~seen], eps=0.1)
            colour[~is_seen] = colour[torch.as_tensor(known[nearest], device=colour.device)]
        return dilated(self.texels.texel, colour, self.texels.resolution), filled


def dilated(index: Int[Tensor, " T"], colour: Float[Tensor, "T 3"], resolution: int) -> Float[Tensor, "N N 3"]:
    """Draw these texels; those up to 4 beside them get the nearest one's colour, the rest is black."""
    texture, is_chart = np.zeros((resolution**2, 3), np.float32), np.zeros(resolution**2, bool)
    texture[index.cpu().numpy()], is_chart[index.cpu().numpy()] = colour.cpu().numpy(), True
    found = distance_transform_edt(~is_chart.reshape(resolution, resolution), return_indices=True)
    assert found is not None, "with indices, both are returned"
    row, column = found[1]
    grown = texture.reshape(resolution, resolution, 3)[row, column]
    grown[found[0] > DILATION_TEXELS] = 0
    return torch.as_tensor(grown, device=colour.device)


def sampled(image: Float[Tensor, "C H W"], place: Float[Tensor, "P 2"]) -> Float[Tensor, "P C"]:
    """Sample at points in [0, 1] (x, y), bilinear; beyond the border, its own."""
    grid = (2 * place - 1)[None, None]
    return grid_sample(image[None], grid, padding_mode="border", align_corners=False)[0, :, 0].T


def draw_textured(
    texture: Float[Tensor, "N N 3"], mesh: PosedMesh, topology: Topology, camera: CameraTensors
) -> tuple[Float[Tensor, "4 H W"], Float[Tensor, "H W"]]:
    """Draw the textured mesh at 2 x 2 sub-pixels, alpha its coverage; and the nearest depth, infinite where none is."""
    finer = _scaled(camera, 2)
    surface = drawn_surface(mesh, topology, finer)
    colour = sampled(texture.permute(2, 0, 1), atlas_uv(topology, surface.samples))
    width, height = finer.size_px
    rgba = torch.cat([colour, torch.ones_like(colour[:, :1])], -1)
    picture = rgba.new_zeros(height * width, 4).index_put((surface.pixel,), rgba).T.reshape(1, 4, height, width)
    depth = depth_map(surface, finer.size_px).reshape(height // 2, 2, width // 2, 2).amin((1, 3))
    return avg_pool2d(picture, 2)[0], depth


def _scaled(camera: CameraTensors, factor: int) -> CameraTensors:
    """Scale the camera of the same view to a multiple of the resolution."""
    K = torch.diag(camera.K.new_tensor([factor, factor, 1])) @ camera.K
    return camera._replace(K=K, size_px=(factor * camera.size_px[0], factor * camera.size_px[1]))


def _barycentric_2d(point: Float[Tensor, "N 2"], corners: Float[Tensor, "N 3 2"]) -> Float[Tensor, "N 3"]:
    a, b, c = corners.unbind(1)
    parts = [_cross(c - b, point - b), _cross(a - c, point - c), _cross(b - a, point - a)]
    return torch.stack(parts, -1) / _cross(b - a, c - a)[:, None]


def _cross(a: Tensor, b: Tensor) -> Tensor:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
