"""Queries the field along traced rays."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor

from .conditions import FrameConditions, gather_field_inputs
from .encoding import FeaturePlane, PlaneReader
from .field import PaperField, PlaneField
from .rays import HandInView, SurfaceRays
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
        """The geometry of traced rays."""
        scale, length = hand.mesh.scale, rays.directions.norm(dim=-1)
        footprint_m = (rays.t / (hand.camera.focal_px * scale)).flatten()
        steps = Steps(rays.t, rays.dt * length / scale * 1000, rays.is_stopped)
        return cls(steps, rays.directions / length[:, None], footprint_m)


def shade(
    field: PaperField | PlaneField,
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
    return field(inputs, steps, read_plane)
