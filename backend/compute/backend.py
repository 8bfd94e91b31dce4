"""The one interface behind which the costly stages of rendering are computed: the reference in torch, or numba.

`compute.reference` computes them in plain torch, on any device, with gradients. `compute.cpu.backend` computes the
same values on the CPU, many times faster. `render.backends` chooses one per device, and everything above is given the
choice.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from typing import Literal, Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from ..field.conditions import FrameConditions
from ..field.field import MlpField, PlaneField
from ..field.rays import CameraTensors, HandInView, RenderedRays, SurfaceRays
from ..field.relightable import LitField
from ..field.sampler import SamplerConfig
from ..field.volume import Composite
from ..geometry.local_rotation import LocalFrames
from ..geometry.mesh import PosedMesh, Topology
from ..geometry.rasterise import NearestFronts
from ..hand.lbs import SkinMotion, SkinTensors
from ..image.relighting import LitImage, SkinDepth
from ..image.surface_means import RayPlaces
from ..light.bounce import Probes, SkinPlaces
from ..light.light_samples import LightSamples
from ..light.lighting import LightFeatures, LightShadows, Openness, SurfacePoints
from ..light.shadow_maps import Bounds, LightViews, PointShadows
from ..light.sky_samples import SkySamples
from ..light.surrounding_light import NearLight
from ..light.surroundings import Patches
from ..records.shot import HandPose
from ..surface.detail_maps import DetailMaps
from ..surface.fine_mesh import FineMesh, FineTemplate, PixelSurface
from ..surface.part_edges import PartEdges
from ..surface.ray_hits import RayHits

Precision = Literal["fp32", "bf16"]
Stage = Literal["pose", "rasterise", "sample", "light", "field", "superres", "decode"]
OnStage = Callable[[Stage], None]


@dataclass(frozen=True)
class RenderHooks:
    """What a caller wants to hear while rays are rendered.

    Attributes:
        on_stage: called when a stage begins; the last stage ends with the frame.
        before_chunk: called before each chunk of rays; what it raises ends the render.
    """

    on_stage: OnStage = lambda stage: None
    before_chunk: Callable[[], None] = lambda: None


Decoder = Callable[[Tensor], Tensor]
"""The layers of a field's decoder: inputs [R, C] -> outputs [R, D], without gradients."""

RayRenderer = Callable[[HandInView, FrameConditions, RenderHooks], RenderedRays]
"""Renders the low-resolution rays of one field, without gradients; what `RenderHooks.before_chunk` raises ends it."""


@runtime_checkable
class RenderBackend(Protocol):
    """The costly stages of rendering and training."""

    @property
    def frames_at_once(self) -> int:
        """Of a sequence, in threads that share the processor, where one by one would take longer."""
        ...

    def threads_of_frame(self, pixels: int) -> AbstractContextManager[None]:
        """A context for the rendering of a frame of this many pixels, in which threads are shared as suits it."""
        ...

    def skin_motion(self, skin: SkinTensors, pose: HandPose) -> SkinMotion:
        """As `hand.lbs.skin_motion`."""
        ...

    def posed_mesh(self, topology: Topology, vertices: Float[Tensor, "V 3"]) -> PosedMesh:
        """As `geometry.mesh.posed_mesh`, without gradients."""
        ...

    def local_rotations(
        self, vertices: Float[Tensor, "V 3"], normals: Float[Tensor, "V 3"], frames: LocalFrames
    ) -> Float[Tensor, "V 3 3"]:
        """As `geometry.local_rotation.local_rotations`, without gradients."""
        ...

    def visibility(self, mesh: PosedMesh, topology: Topology) -> Float[Tensor, "V K"]:
        """As `light.visibility.visibility_transfer`."""
        ...

    def point_shadows(
        self,
        mesh: PosedMesh,
        faces: Int[Tensor, "F 3"],
        occluders: Float[Tensor, "T 3 3"],
        views: LightViews,
        points: Float[Tensor, "P 3"],
        map_px: int,
        bounds: Bounds | None = None,
    ) -> PointShadows:
        """As `light.shadow_maps.point_shadows`."""
        ...

    def first_hit(self, hand: HandInView) -> NearestFronts:
        """As `field.sampler.first_hit`, of the mesh itself."""
        ...

    def openness(self, sky: SkySamples, shadows: PointShadows, normal: Float[Tensor, "R 3"]) -> Openness:
        """As `light.lighting.openness`."""
        ...

    def light_features(self, light: LightSamples, shadows: LightShadows, points: SurfacePoints) -> LightFeatures:
        """As `light.lighting.light_features`."""
        ...

    def skin_places(
        self,
        mesh: PosedMesh,
        faces: Int[Tensor, "F 3"],
        face: Int[Tensor, " R"],
        position: Float[Tensor, "R 3"],
    ) -> SkinPlaces:
        """As `light.bounce.SkinPlaces.of`, without gradients."""
        ...

    def bounced(
        self,
        position: Float[Tensor, "R 3"],
        normal: Float[Tensor, "R 3"],
        probes: Probes,
        shed: Float[Tensor, "P 3"],
    ) -> Float[Tensor, "R 3"]:
        """As `light.bounce.bounced`."""
        ...

    def near_light(
        self, patches: Patches, open_sky: PointShadows, shed: Float[Tensor, "P 3"], points: SurfacePoints
    ) -> NearLight:
        """As `light.surrounding_light.near_light`."""
        ...

    def surface_means(self, values: Float[Tensor, "R C"], places: RayPlaces, stride: int) -> Float[Tensor, "R C"]:
        """As `image.surface_means.surface_means`, without gradients."""
        ...

    def decoder(self, field: PlaneField, device: torch.device, precision: Precision) -> Decoder:
        """As `PlaneField.decoded`, without gradients; the field's weights must not change."""
        ...

    def decoder_inputs(
        self, field: LitField, gathered: Composite, view: Float[Tensor, "R 3"], open_to: Openness
    ) -> Float[Tensor, "R C"]:
        """As `LitField.decoder_inputs`, without gradients."""
        ...

    def superres(self, network: nn.Module, device: torch.device, precision: Precision) -> Callable[[Tensor], Tensor]:
        """A super-resolution network as a function of maps, without gradients; its weights must not change."""
        ...

    def lit_image(
        self,
        superres: Callable[[Tensor], Tensor],
        low: Composite,
        points: SurfacePoints,
        pixel: Int[Tensor, " R"],
        camera: CameraTensors,
        skin: SkinDepth,
    ) -> LitImage:
        """As `image.relighting.lit_image`, without gradients."""
        ...

    def fine_mesh(
        self,
        template: FineTemplate,
        motion: SkinMotion,
        height_m: Float[Tensor, " N"],
        flex: Float[Tensor, " V"],
        scale: Float[Tensor, ""],
    ) -> FineMesh:
        """As `surface.fine_mesh.fine_mesh`, without gradients."""
        ...

    def seen_surface(self, mesh: FineMesh, camera: CameraTensors) -> PixelSurface:
        """As `surface.fine_mesh.seen_surface`."""
        ...

    def ray_hits(self, mesh: FineMesh, camera: CameraTensors, pixel: Int[Tensor, " R"]) -> RayHits:
        """As `surface.ray_hits.ray_hits`."""
        ...

    def detailed_image(
        self, image: LitImage, seen: PixelSurface, mesh: FineMesh, camera: CameraTensors, maps: DetailMaps
    ) -> LitImage:
        """As `surface.skin_detail.detailed_image`, without gradients."""
        ...

    def relit(
        self, image: LitImage, features: LightFeatures, pixel: Int[Tensor, " R"], size_px: tuple[int, int]
    ) -> Float[Tensor, "3 H W"]:
        """As `image.relighting.relit`, without gradients."""
        ...

    def blended(
        self,
        colours: Float[Tensor, "3 H W"],
        alpha: Float[Tensor, "H W"],
        depth: Float[Tensor, "H W"],
        edges: PartEdges,
    ) -> Float[Tensor, "3 H W"]:
        """As `surface.part_edges.blended`."""
        ...

    def trace(self, hand: HandInView, config: SamplerConfig, generator: torch.Generator | None = None) -> SurfaceRays:
        """As `field.trace.trace`."""
        ...

    def shade(
        self,
        field: MlpField | PlaneField,
        rays: SurfaceRays,
        hand: HandInView,
        conditions: FrameConditions,
        shell_m: float,
    ) -> Composite:
        """As `field.shade.shade`, with gradients to the weights and, if required, to the geometry."""
        ...

    def ray_renderer(self, field: MlpField | PlaneField, config: SamplerConfig, precision: Precision) -> RayRenderer:
        """A renderer of this field; the field's weights must not change while it is used."""
        ...


@cache
def has_fast_bf16(device: torch.device) -> bool:
    """Whether bf16 is no slower than fp32 there.

    Processors without AVX-512 (on Arm: without bf16 instructions) compute torch's bf16 number by number: networks take
    ten times as long.
    """
    is_supported = getattr(torch.ops.mkldnn, "_is_mkldnn_bf16_supported", lambda: False)
    return device.type != "cpu" or is_supported()


def autocast(device: torch.device, precision: Precision) -> torch.autocast:
    """The context in which networks run: bf16 is autocast, where it is not slower than fp32; geometry never is."""
    return torch.autocast(device.type, torch.bfloat16, enabled=precision == "bf16" and has_fast_bf16(device))


def in_precision(network: nn.Module, device: torch.device, precision: Precision) -> Callable[[Tensor], Tensor]:
    """The network as a function that runs in its own autocast."""

    def run(values: Tensor) -> Tensor:
        with autocast(device, precision):
            return network(values)

    return run


def decoder_in_precision(field: PlaneField, device: torch.device, precision: Precision) -> Decoder:
    """The field's decoder as a function that runs in its own autocast."""

    def run(values: Tensor) -> Tensor:
        with autocast(device, precision):
            return field.decoded(values)

    return run
