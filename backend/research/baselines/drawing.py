"""The mesh as pictures: which surface point each pixel shows."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ...field.rays import CameraTensors, project, ray_directions, ray_origin
from ...geometry.closest_point import closest_on_triangles
from ...geometry.mesh import PosedMesh, Topology
from ...geometry.rasterise import rasterise
from ...geometry.uvh import SurfaceSamples, interpolate


class DrawnSurface(NamedTuple):
    """The nearest front of P pixels.

    Attributes:
        pixel: [P] row * width + column.
        depth: [P] m along the optical axis.
        samples: the surface points, of height 0.
    """

    pixel: Tensor
    depth: Tensor
    samples: SurfaceSamples


def drawn_surface(mesh: PosedMesh, topology: Topology, camera: CameraTensors) -> DrawnSurface:
    """Draw what each pixel shows of the mesh's front faces."""
    fragments = rasterise(*project(camera, mesh.vertices), topology.faces, camera.size_px)
    pixel, face, depth = (values[fragments.is_front] for values in fragments[:3])
    first = nearest_of_each(pixel, depth)
    pixel, face, depth = pixel[first], face[first], depth[first]
    points = ray_origin(camera) + depth[:, None] * ray_directions(camera, pixel)
    barycentric, _ = closest_on_triangles(points, mesh.vertices[topology.faces[face]])
    return DrawnSurface(pixel, depth, SurfaceSamples(face, barycentric, torch.zeros_like(depth)))


def nearest_of_each(key: Int[Tensor, " N"], value: Float[Tensor, " N"]) -> Int[Tensor, " K"]:
    """Find the index of the least value of each key, keys ascending."""
    order = torch.argsort(value)
    order = order[torch.argsort(key[order], stable=True)]
    sorted_key = key[order]
    is_first = torch.ones_like(sorted_key, dtype=torch.bool)
    is_first[1:] = sorted_key[1:] != sorted_key[:-1]
    return order[is_first]


def depth_map(surface: DrawnSurface, size_px: tuple[int, int]) -> Float[Tensor, "H W"]:
    """Compute depth per pixel, infinite where there is no surface, m."""
    width, height = size_px
    empty = surface.depth.new_full((height * width,), torch.inf)
    return empty.index_put((surface.pixel,), surface.depth).reshape(height, width)


def normal_map(
    mesh: PosedMesh, topology: Topology, camera: CameraTensors, surface: DrawnSurface
) -> Float[Tensor, "3 H W"]:
    """Draw normals in the camera's axes, zero where there is no surface."""
    normals = torch.nn.functional.normalize(interpolate(mesh.normals, topology, surface.samples), dim=-1)
    width, height = camera.size_px
    image = normals.new_zeros(height * width, 3).index_put((surface.pixel,), normals @ camera.world2cam[:3, :3].T)
    return image.T.reshape(3, height, width)
