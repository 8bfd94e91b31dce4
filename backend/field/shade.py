"""Queries the field along traced rays."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor

from ..geometry.bones import points_in_bones
from ..geometry.uvh import interpolate
from .conditions import FrameConditions, SamplePoints, gather_field_inputs
from .encoding import FeaturePlane, PlaneReader
from .field import MlpField, PlaneField
from .rays import HandInView, SurfaceRays, ray_origins
from .volume import Composite, Steps


class RayGeometry(NamedTuple):
    """What shading needs of R rays of N samples.

    Attributes:
        steps: of the rays.
        view: [R, 3] unit directions, world.
        footprint_m: [S] width of a pixel at each sample, in the template's metres.
    """

    steps: Steps
    view: Tensor
    footprint_m: Tensor

    @classmethod
    def of(cls, rays: SurfaceRays, hand: HandInView) -> RayGeometry:
        """Compute the geometry of traced rays."""
        scale, length = hand.mesh.scale, rays.directions.norm(dim=-1)
        footprint_m = (hand.camera.divisor(rays.t) / (hand.camera.focal_px * scale)).flatten()
        steps = Steps(rays.t, rays.dt * length / scale * 1000, rays.is_stopped)
        return cls(steps, rays.directions / length[:, None], footprint_m)


def shade(
    field: MlpField | PlaneField,
    rays: SurfaceRays,
    hand: HandInView,
    conditions: FrameConditions,
    shell_m: float,
    read_plane: PlaneReader = FeaturePlane.forward,
) -> Composite:
    """Query the field at the samples and composite each ray; `read_plane` reads the field's planes."""
    steps, view, footprint_m = RayGeometry.of(rays, hand)
    light = field.light_code(conditions.visibility)
    inputs = gather_field_inputs(rays.samples, hand.topology, conditions, light, view, footprint_m, shell_m)
    if isinstance(field, MlpField) and field.asks != "surface":
        inputs = inputs._replace(place=_points(rays, hand, conditions, field.asks == "bones"))
    return field(inputs, steps, read_plane)


def _points(rays: SurfaceRays, hand: HandInView, conditions: FrameConditions, in_bones: bool) -> SamplePoints:
    """Compute where the samples lie in space."""
    origins = ray_origins(hand.camera, rays.pixel)[:, None, :]
    points = (origins + rays.t[..., None] * rays.directions[:, None, :]).flatten(0, 1)
    if not in_bones or conditions.bones is None or conditions.bone_weights is None:
        return SamplePoints(points, points.new_zeros(len(points), 0, 3), points.new_zeros(len(points), 0))
    weights = interpolate(conditions.bone_weights, hand.topology, rays.samples)
    return SamplePoints(points, points_in_bones(points, conditions.bones) / hand.mesh.scale, weights)
