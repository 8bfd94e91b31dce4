"""Normals of a known fine surface where rays meet it: light falls on these, not on what a field's planes resolve."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from .fine_mesh import FineMesh, PixelSurface, barycentric, blend_corners
from .rays import CameraTensors


def ray_normals(
    mesh: FineMesh,
    seen: PixelSurface,
    camera: CameraTensors,
    pixel: Int[Tensor, " R"],
    position: Float[Tensor, "R 3"],
    edge_m: Float[Tensor, ""],
) -> Float[Tensor, "R 3"]:
    """Unit normals, world; zeros where a ray does not meet the surface.

    A ray lies between four pixels of the full-size image. It meets the face of the one that is nearest in depth.

    Args:
        mesh: posed.
        seen: of it, at full size.
        camera: of the full-size image.
        pixel: of the rays, in the image of half that size.
        position: where rays meet the skin, m, world.
        edge_m: depths that differ by more are of two surfaces.
    """
    width, depth = camera.size_px[0], position @ camera.world2cam[2, :3] + camera.world2cam[2, 3]
    x, y = 2 * (pixel % (width // 2)), 2 * torch.div(pixel, width // 2, rounding_mode="floor")
    around = torch.stack([(y + below) * width + x + right for below in (0, 1) for right in (0, 1)])
    gap = torch.where(seen.face[around] >= 0, (seen.depth[around] - depth).abs(), torch.inf)
    least = gap.min(0, keepdim=True)
    ray = (least.values[0] < edge_m).nonzero()[:, 0]
    face = seen.face[around.gather(0, least.indices)[0, ray]].long()
    weights = barycentric(mesh, camera, face, torch.stack([x, y], 1)[ray] + 1.0)
    normals = normalize(blend_corners(mesh.normals[mesh.faces[face]], weights), dim=-1)
    return torch.zeros_like(position).index_put((ray,), normals)
