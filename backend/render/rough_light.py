"""Rough relighting of avatars whose light is baked in: a frame times the quotient of two lights.

The quotient is that of the diffuse light that the mesh receives in the scene and in the avatar's own capture. Shadows
and colours of the light come out right, relief and gloss stay those of the capture. The light of synthetic captures is
known; that of photographs is not, and such avatars stay as they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import avg_pool2d

from ..avatars.avatar import Avatar
from ..capture.dome import dome_sky
from ..compute.reference import ReferenceBackend
from ..field.rays import HandInView, ray_directions, ray_origin
from ..hand.model import HandModel
from ..image.crop import Crop
from ..image.superres import enlarge
from ..light.bounce import SkinPlaces
from ..light.light_samples import LightSamples
from ..light.lighting import SurfacePoints, diffuse_light
from ..light.shadow_maps import Bounds
from ..records.frame import Frame
from ..records.light import Light
from ..records.shot import Shot
from .lit_rays import light_shadows, occluding_triangles, sky_shadows, with_parts
from .surface_maps import surface_maps

# Share of the mean diffuse light that reaches every point, reflected by the hand itself.
_REFLECTED = 0.12
# Pixels by which the quotient is continued beyond the mesh, to which super-resolution adds an edge.
_MARGIN_PX = 4


def baked_light(avatar: Avatar) -> Light | None:
    """The light that is baked into an avatar; None: not known."""
    if avatar.sky is not None:
        return Light(sky=avatar.sky)
    capture = avatar.provenance.get("capture", {})
    is_dome = capture.get("made_by") == "livehand capture" and "hand" not in capture
    return Light(sky=dome_sky()) if is_dome else None


def roughly_relit(
    frame: Frame, shot: Shot, hand: HandInView, crop: Crop, model: HandModel, backend: ReferenceBackend, own: Light
) -> Frame:
    """A baked avatar's frame in the shot's light.

    Args:
        frame: in the avatar's own light.
        shot: with a light.
        hand: posed, in the low-resolution view of the crop.
        crop: of the image.
        model: of the mesh.
        backend: casts the shadows.
        own: the light that is baked in.
    """
    light = shot.light or own
    quotient = _quotient(shot, hand, crop, model, backend, (light, own))
    factor = np.ones_like(frame.rgb)
    crop.paste(quotient.permute(1, 2, 0).cpu().numpy(), factor)
    return replace(frame, rgb=frame.rgb * factor, is_lit=True)


def _quotient(
    shot: Shot, hand: HandInView, crop: Crop, model: HandModel, backend: ReferenceBackend, lights: tuple[Light, Light]
) -> Float[Tensor, "3 H W"]:
    """The first light over the second, on the crop at full size."""
    pixel, points = _mesh_points(shot, hand, crop, model, backend)
    first, second = (_received(light, hand, backend, points) for light in lights)
    width, height = crop.width, crop.height
    maps = first.new_zeros(height * width, 4)
    maps[pixel] = torch.cat([first / second, torch.ones(len(pixel), 1, device=first.device)], 1)
    image = enlarge(maps.T.reshape(1, 4, height, width))
    spread = avg_pool2d(image, 2 * _MARGIN_PX + 1, stride=1, padding=_MARGIN_PX)
    known = torch.where(image[:, 3:] > 0, image, spread)[0]
    return torch.where(known[3:] > 0, known[:3] / known[3:].clamp(min=1e-6), torch.ones_like(known[:3]))


def _mesh_points(
    shot: Shot, hand: HandInView, crop: Crop, model: HandModel, backend: ReferenceBackend
) -> tuple[Tensor, SurfacePoints]:
    """The pixels of the low-resolution crop that show the mesh, and where their rays meet it."""
    hit = backend.first_hit(hand)
    normals = surface_maps(replace(shot, camera=crop.camera_of(shot.camera)), model).normal.reshape(-1, 3)
    normal = torch.as_tensor(normals, dtype=torch.float32, device=hit.depth.device)
    pixel = (hit.depth.isfinite() & (normal.norm(dim=-1) > 0)).nonzero()[:, 0]
    directions = ray_directions(hand.camera, pixel)
    position = ray_origin(hand.camera) + hit.depth[pixel, None] * directions
    view = torch.nn.functional.normalize(directions, dim=-1)
    places = SkinPlaces.of(hand.mesh, hand.topology.faces, hit.face[pixel], position)
    return pixel, SurfacePoints(position, normal[pixel], normal[pixel], view, places)


def _received(light: Light, hand: HandInView, backend: ReferenceBackend, points: SurfacePoints) -> Float[Tensor, "R 3"]:
    """Diffuse light at points, softened as skin softens it, with some that the hand reflects on itself."""
    samples, position = LightSamples.of(light, Bounds.of(hand.mesh)), points.position
    occluders = occluding_triangles(light, position.device)
    of_sky = sky_shadows(backend, hand, occluders, position)
    of_sky = with_parts(of_sky, samples.sky, backend, hand, occluders, position)
    shadows = light_shadows(backend, hand, samples, occluders, position, of_sky, position.new_zeros(3))
    features = backend.light_features(samples, shadows, points)
    diffuse = 0.5 * (diffuse_light(features, points.normal) + features.scattered[:, 1])
    return diffuse + _REFLECTED * shadows.probes.mean_received(samples) + 1e-6
