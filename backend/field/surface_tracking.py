"""Projects the samples of a ray onto the surface: onto the part that the ray has entered, tracked along the ray.

The closest point of the whole mesh is wrong in contact: where a thumb touches a fist, a sample just inside the thumb
may be nearer to the fist's skin, and would get its colour. So each part whose shell the ray is in is tracked by itself,
starting at the face through which the ray entered. Of several parts, the sample belongs to the one that holds it
deepest, which renders the union of the parts.

Tracking walks from the last sample's face to a nearer neighbouring face, until there is none. Near a single part, this
finds the closest point of the whole mesh.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ..geometry.closest_point import closest_on_triangles
from ..geometry.mesh import PosedMesh, Topology
from ..geometry.tolerances import MAX_STEPS
from ..geometry.uvh import SurfaceSamples, signed_height
from .rays import HandInView, SurfaceRays
from .sampler import SamplerConfig, sample_rays


def track(
    points: Float[Tensor, "R N 3"],
    entry_face: Int[Tensor, "R L"],
    is_open: Bool[Tensor, "R N L"],
    topology: Topology,
    mesh: PosedMesh,
) -> SurfaceSamples:
    """Project R rays of N samples, ordered along the ray, onto the surface.

    Args:
        points: world, m.
        entry_face: faces at which each ray enters the inflated mesh; the padding is ignored.
        is_open: which of those crossings lie before each sample, in the sample's own interval.
        topology: of the mesh.
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
    """Walk to the closest point of the part that `face` is on: face, barycentrics, squared distance."""
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
    """Find the closest point of a face and its neighbours; the face itself comes first and wins ties."""
    candidates = topology.neighbours[face]
    barycentric, squared = closest_on_triangles(points[:, None, :], triangles[candidates])
    squared, best = squared.min(1)
    barycentric = barycentric.gather(1, best[:, None, None].expand(-1, 1, 3))[:, 0]
    return candidates.gather(1, best[:, None])[:, 0], barycentric, squared


def _deepest(found: SurfaceSamples, ray: Int[Tensor, " P"], rays: int) -> SurfaceSamples:
    """Choose the candidate of least height per ray; every ray has at least one."""
    order = torch.argsort(found.height_m, stable=True)
    order = order[torch.argsort(ray[order], stable=True)]
    is_first = torch.ones_like(order, dtype=torch.bool)
    is_first[1:] = ray[order][1:] != ray[order][:-1]
    return SurfaceSamples(*(values[order[is_first]] for values in found))


def trace(hand: HandInView, config: SamplerConfig, generator: torch.Generator | None = None) -> SurfaceRays:
    """Sample the rays that meet the shell and project the samples onto the surface.

    Args:
        hand: the posed hand and its camera.
        config: of the sampler.
        generator: jitters the samples within their strata; None puts them at the strata's centres.
    """
    rays, mesh = sample_rays(hand, config, generator), hand.mesh
    samples = track(rays.points, rays.entry_face, rays.is_open, hand.topology, mesh)
    samples = SurfaceSamples(samples.face, samples.barycentric, samples.height_m / mesh.scale)
    return SurfaceRays(rays.pixel, rays.directions, rays.t, rays.dt, rays.is_stopped, samples)
