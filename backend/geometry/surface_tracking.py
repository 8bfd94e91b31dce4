"""Lays the samples of a ray on the surface: on the part of it that the ray entered, tracked from sample to sample.

The nearest point of the whole mesh would do but for contact: where a thumb lies on a fist, a sample just inside the
thumb may be nearer to the fist's skin, and would take its colour. So every part whose shell a ray is in is followed by
itself, from the face through which the ray entered it, and of several parts the one that holds the sample deepest owns
it: what is seen is the parts' union.

A part is followed by walking: from the last sample's face to whichever face around it is nearer, until none is. Where a
single part is near, that finds the closest point of the whole mesh.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from .closest_point import closest_on_triangles
from .mesh import PosedMesh, Topology
from .tolerances import MAX_STEPS
from .uvh import SurfaceSamples, signed_height


def track(
    points: Float[Tensor, "R N 3"],
    entry_face: Int[Tensor, "R L"],
    is_open: Bool[Tensor, "R N L"],
    topology: Topology,
    mesh: PosedMesh,
) -> SurfaceSamples:
    """Lay R rays of N samples, in order, on the surface.

    Args:
        points: world, m.
        entry_face: where each ray crosses the front of the inflated mesh; anything where it does not.
        is_open: which of those crossings lie before each sample, in the sample's own interval.
        topology: of the hand.
        mesh: the pose.

    Returns:
        The R * N samples.
    """
    rays, count = points.shape[:2]
    face = entry_face.clone()
    parts = []
    for index in range(count):
        ray, entry = is_open[:, index].nonzero(as_tuple=True)
        walked, barycentric, squared = _walk(points[ray, index], face[ray, entry], topology, mesh)
        face[ray, entry] = walked
        found = SurfaceSamples(walked, barycentric, squared.sqrt())
        height = signed_height(points[ray, index], found, topology, mesh)
        parts.append(_deepest(SurfaceSamples(walked, barycentric, height), ray, rays))
    stacked = (torch.stack(values, 1).flatten(0, 1) for values in zip(*parts, strict=True))
    return SurfaceSamples(*stacked)


def _walk(
    points: Float[Tensor, "P 3"], face: Int[Tensor, " P"], topology: Topology, mesh: PosedMesh
) -> tuple[Int[Tensor, " P"], Float[Tensor, "P 3"], Float[Tensor, " P"]]:
    """The closest point of the part that `face` is on: face, barycentrics, squared distance."""
    triangles = mesh.vertices[topology.faces]
    found = _closest_around(points, face, topology, triangles)
    for _ in range(MAX_STEPS - 1):
        if bool((found[0] == face).all()):
            break
        face = found[0]
        found = _closest_around(points, face, topology, triangles)
    return found


def _closest_around(
    points: Float[Tensor, "P 3"], face: Int[Tensor, " P"], topology: Topology, triangles: Float[Tensor, "F 3 3"]
) -> tuple[Int[Tensor, " P"], Float[Tensor, "P 3"], Float[Tensor, " P"]]:
    """The closest point of a face and those around it; the face itself comes first and wins ties."""
    candidates = topology.neighbours[face]
    barycentric, squared = closest_on_triangles(points[:, None, :], triangles[candidates])
    squared, best = squared.min(1)
    barycentric = barycentric.gather(1, best[:, None, None].expand(-1, 1, 3))[:, 0]
    return candidates.gather(1, best[:, None])[:, 0], barycentric, squared


def _deepest(found: SurfaceSamples, ray: Int[Tensor, " P"], rays: int) -> SurfaceSamples:
    """Of each ray's candidates the one of least height; every ray has one at least."""
    order = torch.argsort(found.height_m, stable=True)
    order = order[torch.argsort(ray[order], stable=True)]
    is_first = torch.ones_like(order, dtype=torch.bool)
    is_first[1:] = ray[order][1:] != ray[order][:-1]
    return SurfaceSamples(*(values[order[is_first]] for values in found))
