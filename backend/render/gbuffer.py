"""The G-buffer of a relightable avatar: everything about a hand in a view that does not depend on the light.

`RelightableNetworks` makes its pixels from the rays that the field has gathered, in two steps: `decoded` and
`enlarged`. Frames and training take the same road through it. Training gives it the reference backend, for gradients,
and networks that still change; frames give it copies, and the backend of the device.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ..compute.precision import Decoder, Precision
from ..compute.reference import ReferenceBackend
from ..field.rays import project
from ..field.relightable import RelightableField
from ..field.volume import Composite
from ..image.crop import Crop
from ..image.shading import ShadingInputs, SurfaceDepth, shade_rays
from ..light.lighting import LightFeatures, SurfacePoints, reflectance
from ..light.shadow_maps import Bounds, PointShadows
from ..light.sky_samples import SkySamples
from ..records.depth_profile import DepthProfile
from ..records.light import MeasuredLight
from ..records.shot import Shot
from ..surface.edge_antialiasing import EdgePixels
from ..surface.hairs import VisibleHairs
from ..surface.hole_filling import drop_outliers
from .light_visibility import split_points
from .primary_hits import HitSurface, PrimaryHits, is_off_edges, surface_points


class DecodedRays(NamedTuple):
    """The rays of a relightable field with what light is multiplied by.

    Attributes:
        points: where they meet the skin, with the normals of the field.
        low: their coefficients and features, premultiplied.
    """

    points: SurfacePoints
    low: Composite

    @property
    def mean_albedo(self) -> Float[Tensor, " 3"]:
        """Of the skin that they show, without gradients."""
        low = self.low._replace(channels=self.low.channels.detach(), alpha=self.low.alpha.detach())
        return (reflectance(low.channels).sum(0) / low.alpha.sum().clamp(min=1)).clamp(max=1)

    def colours(self, features: LightFeatures) -> Float[Tensor, "R 3"]:
        """Return their scene-linear colours in a light, premultiplied."""
        return shade_rays(self.low, self.points, features)


@dataclass(frozen=True)
class RelightableNetworks:
    """The networks of a relightable avatar in one precision.

    Attributes:
        field: whose rays are decoded.
        decoder: of the field.
        superres: super-resolution.
        backend: computes all that is between the networks and the image.
    """

    field: RelightableField
    decoder: Decoder
    superres: Callable[[Tensor], Tensor]
    backend: ReferenceBackend

    @classmethod
    def of(
        cls, field: RelightableField, superres: nn.Module, backend: ReferenceBackend, precision: Precision
    ) -> RelightableNetworks:
        """Prepare networks for a backend; they are on one device."""
        device = next(field.parameters()).device
        decoder = backend.decoder(field, device, precision)
        return cls(field, decoder, backend.superres(superres, device, precision), backend)

    def decoded(self, met: PrimaryHits, gathered: Composite, sky_visibility: PointShadows) -> DecodedRays:
        """Decode the rays that the field has gathered.

        Args:
            met: where the rays meet the skin.
            gathered: along them.
            sky_visibility: of the points, by the hand alone.
        """
        points = surface_points(self.field, gathered, met.position, met.view, met.hit_points, met.hits)
        at_points, _ = split_points(sky_visibility, len(points.position))
        occlusion = self.backend.ambient_occlusion(SkySamples.of(None, met.pixel.device), at_points, points.normal)
        low = self.field.decode(gathered, met.view, occlusion, self.decoder, self.backend.decoder_inputs)
        return DecodedRays(points, low)

    def enlarged(self, met: PrimaryHits, rays: DecodedRays, skin: SurfaceDepth) -> ShadingInputs:
        """Enlarge decoded rays to the full-size image.

        Args:
            met: where the rays meet the skin.
            rays: decoded.
            skin: depth of what the full-size image shows, by which it takes the light of rays on the same surface.
        """
        points = rays.points
        reported = points if met.hits is None else drop_outliers(points, rays.low.alpha, met.hits, skin.edge_m)
        return self.backend.shading_inputs(self.superres, rays.low, reported, met.pixel, met.hand.camera, skin)


class SurfaceLayer(NamedTuple):
    """The avatar's surface in a G-buffer.

    Attributes:
        hit: that the rays meet.
        depth: of it at the low resolution's pixels.
        edges: where one part of it ends before or against another.
        hairs: over it; None: there are none.
    """

    hit: HitSurface
    depth: SurfaceDepth
    edges: EdgePixels
    hairs: VisibleHairs | None


@dataclass(frozen=True)
class GBuffer:
    """A hand at full size, in no light.

    Attributes:
        shot: what it shows; its light is not read.
        crop: of the image.
        met: where the rays meet the skin, in the low-resolution view.
        points: the same with the normals of the field.
        sky_visibility: shadows of the sky by the hand alone, as `sky_shadows` gives them.
        image: coefficients and normals.
        albedo: [V, 3] of the skin at the mesh's vertices.
        profile: of the rays; None: the image shows the avatar's surface.
        layer: that surface; None: the avatar has none.
    """

    shot: Shot
    crop: Crop
    met: PrimaryHits
    points: SurfacePoints
    sky_visibility: PointShadows
    image: ShadingInputs
    albedo: Tensor
    profile: DepthProfile | None
    layer: SurfaceLayer | None

    def shows(self, shot: Shot) -> bool:
        """Return whether a shot differs by its light at most."""
        ours, theirs = self.shot, shot
        return (
            ours.camera.size_px == theirs.camera.size_px
            and ours.camera.is_orthographic == theirs.camera.is_orthographic
            and ours.pose.side == theirs.pose.side
            and (ours.hair, ours.quality) == (theirs.hair, theirs.quality)
            and np.array_equal(ours.vertices, theirs.vertices)
            and _is_equal(ours.pressed_m, theirs.pressed_m)
            and np.array_equal(ours.pose.theta, theirs.pose.theta)
            and np.array_equal(ours.camera.K, theirs.camera.K)
            and np.array_equal(ours.camera.cam2world, theirs.camera.cam2world)
        )

    @cached_property
    def bounds(self) -> Bounds:
        """Of the mesh."""
        return Bounds.of(self.met.hand.mesh)

    def is_measured(self, measured: MeasuredLight) -> Bool[Tensor, " R"]:
        """Return whether the surface on which light was measured shows the skin that a ray meets, and nothing else."""
        shown = self.layer.depth if measured.on_surface and self.layer is not None else self.met.mesh_depth
        camera = self.met.hand.camera
        _, depth = project(camera, self.points.position)
        return is_off_edges(shown, depth, self.met.pixel, camera.size_px)


def _is_equal(one: np.ndarray | None, other: np.ndarray | None) -> bool:
    return one is other or (one is not None and other is not None and np.array_equal(one, other))
