"""Training images of a relightable avatar: each instant in all of its light groups, mixed anew at every step.

A light group, a photograph in one lamp and one in an environment are each an image in one light. Light adds up, so any
mixture of the images of one instant shows the hand in the same mixture of their lights: exact, free variety.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..capture.capture import Capture, CaptureView
from ..evaluation.exposure import LEAST_LIT, WHITE, WHITE_SHARE
from ..field.rays import CameraTensors, HandInView, view_directions
from ..field.sampler import SamplerConfig
from ..geometry.mesh import PosedMesh
from ..hand.model import HandModel
from ..image.relighting import covered_pixels, doubled
from ..image.srgb import linear_to_srgb
from ..light.bounce import SkinPlaces
from ..light.lamp_samples import LampSamples
from ..light.light_samples import LightSamples
from ..light.lighting import LightShadows
from ..light.shadow_maps import MAX_DEPTH_IN_M, Bounds, PointShadows
from ..light.sky_samples import SkySamples, division_of
from ..light.surrounding_light import SurroundingLight
from ..records.errors import LiveHandError
from ..records.light import Light
from ..render.known_skin import KnownSkin, skin_of_capture
from ..render.lit_rays import (
    NO_OCCLUDERS,
    HitSurface,
    light_shadows,
    occluding_triangles,
    ray_positions,
    skin_layers,
    sky_shadows,
    surrounding_light,
    with_parts,
)
from ..surface.fine_mesh import FineMesh, FineTemplate, on_surface
from ..surface.ray_hits import RayHits
from ..surface.skin_detail import PixelSkin, pixel_skin
from .crop_store import CropStore
from .views import TrainingView, TrainingViews

_GAIN_SPREAD, _COLOUR_SPREAD = 0.7, 0.25
"""Standard deviations of a group's random gain, and of its colours against it, as natural logarithms."""
_LEFT_OUT = 0.2
"""Probability with which a group is left out, if another remains."""


class SeenSkin(NamedTuple):
    """What a view of R rays shows of a known skin.

    Attributes:
        pixels: of the full-size image.
        hits: of the rays.
    """

    pixels: PixelSkin
    hits: RayHits


class ViewLight(NamedTuple):
    """The light of one instant, in G groups.

    Attributes:
        skies: of the groups.
        lamps: of all groups.
        group_of_lamp: [L].
        shadows: of sky and lamps at the rays' points.
        open_sky: shadows of the sky by the hand alone, as `sky_shadows` gives them.
        position: [R, 3] of the rays' points, m.
        places: of these on the mesh.
        targets: [G, 3, 2h, 2w] linear premultiplied colours.
        alpha: [2h, 2w].
        skin: what the view shows of it, where it is known.
        around: light from what stands around; None: nothing does.
    """

    skies: tuple[SkySamples, ...]
    lamps: LampSamples
    group_of_lamp: Tensor
    shadows: LightShadows
    open_sky: PointShadows
    position: Tensor
    places: SkinPlaces
    targets: Tensor
    alpha: Tensor
    skin: SeenSkin | None
    around: SurroundingLight | None


class MixedLight(NamedTuple):
    """One mixture of the light groups.

    Attributes:
        samples: its light.
        shadows: at the rays' points.
        open_sky: shadows of the sky by the hand alone, as `sky_shadows` gives them.
        position: [R, 3] of the rays' points, m.
        places: of these on the mesh.
        exposure: [] factor of linear colours before they are encoded.
        skin: what the view shows of it, where it is known.
        around: light from what stands around; None: nothing does.
    """

    samples: LightSamples
    shadows: LightShadows
    open_sky: PointShadows
    position: Tensor
    places: SkinPlaces
    exposure: Tensor
    skin: SeenSkin | None
    around: SurroundingLight | None

    def encoded(self, linear: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
        """Exposed and sRGB-encoded; values over 1 continue the curve."""
        return linear_to_srgb((linear * self.exposure).clamp(min=0))


class LitTrainingViews(TrainingViews):
    """The instants of a capture with lights; `views` holds the first image of each.

    Raises:
        LiveHandError: an image's light is not known, or the capture is of another hand.
    """

    def __init__(
        self,
        capture: Capture,
        views: tuple[CaptureView, ...],
        hand: HandModel,
        sampler: SamplerConfig,
        device: torch.device,
        seed: int,
    ):
        unknown = [view.file for view in views if view.light is None]
        if unknown:
            raise LiveHandError(
                f"a relightable avatar needs the light of every image, {len(unknown)} have none, such as {unknown[0]}; "
                "capture with --lights varied, or train with --config default"
            )
        instants = _instants(views)
        _check_occluders(capture, instants)
        super().__init__(capture, tuple(group[0] for group in instants), hand, sampler, device, seed)
        by_file = {group[0].file: group for group in instants}
        self._groups = [by_file[view.file] for view in self.views]
        self._kept_light: dict[int, tuple] = {}
        self._kept_skin: dict[int, SeenSkin] = {}
        self._hand_poses = list(capture.poses)

    def get(self, index: int, jitter: int) -> TrainingView:
        """Instant `index` with its `jitter`-th set of samples, and its light before it is mixed."""
        view = super().get(index, jitter)
        return view._replace(light=self._light(index, view))

    def _visibility(self, mesh: PosedMesh) -> Tensor:
        """None: shadows come with the light."""
        return mesh.vertices.new_zeros(len(mesh.vertices), 0)

    def _target(self, index: int) -> Float[Tensor, "4 H W"]:
        """Alpha alone: colours depend on how the light is mixed."""
        return self._linear(index)[0]

    def _linear(self, index: int) -> Float[Tensor, "G 4 H W"]:
        first = self._first_entry[index]
        crops = [self._pixels.get(first + group) for group in range(len(self._groups[index]))]
        return torch.as_tensor(np.stack(crops)).to(self.device).float().permute(0, 3, 1, 2)

    @cached_property
    def _first_entry(self) -> list[int]:
        return np.cumsum([0, *(len(group) for group in self._groups)]).tolist()

    @cached_property
    def _pixels(self) -> CropStore:
        entries = [(view, crop) for group, crop in zip(self._groups, self._crops, strict=True) for view in group]
        capture = self.capture  # the store's threads must not reference self

        def decode(index: int) -> np.ndarray:
            view, crop = entries[index]
            return crop.cut(capture.read_linear(view)).astype(np.float16)

        sizes_px = [(2 * crop.width, 2 * crop.height) for _, crop in entries]
        return CropStore(sizes_px, decode, capture.folder, dtype=np.float16)

    def _light(self, index: int, view: TrainingView) -> ViewLight:
        lights = [self.capture.lights[entry.light].light for entry in self._groups[index] if entry.light is not None]
        bounds = Bounds.of(view.mesh)
        lamps = LampSamples.of(tuple(lamp for light in lights for lamp in light.lamps), bounds)
        group_of_lamp = [group for group, light in enumerate(lights) for _ in light.lamps]
        # In the same directions: those that a kept frame would take for their sum.
        division = division_of((light.sky for light in lights), "fine")
        skies = tuple(SkySamples.of(light.sky, self.device, division) for light in lights)
        hand = HandInView(view.mesh, self.topology, view.camera)
        layers, (pixel, directions, t, dt) = skin_layers(self.backend, hand), view.rays[:4]
        skin = self._skin_at(index, view)
        hits = None if skin is None else skin.hits
        position = ray_positions(hand, layers.first, pixel, directions, t, dt, hits)
        together = LightSamples(SkySamples.mixed(skies, torch.ones(len(skies), 3, device=self.device)), lamps)

        def surface() -> HitSurface | None:
            mesh = self._fine_mesh(index, view.mesh)
            if mesh is None or hits is None:
                return None
            return HitSurface(mesh, hits.positions(view.camera, directions, position))

        shadows, open_sky, around = self._shadows(index, hand, together, lights, position, surface)
        linear = self._linear(index)
        return ViewLight(
            skies=skies,
            lamps=lamps,
            group_of_lamp=torch.tensor(group_of_lamp, dtype=torch.long, device=self.device),
            shadows=shadows,
            open_sky=open_sky,
            position=position,
            places=layers.places(hand, layers.first, pixel, position, hits),
            targets=linear[:, :3],
            alpha=linear[0, 3],
            skin=skin,
            around=around,
        )

    @cached_property
    def _skin(self) -> KnownSkin | None:
        return skin_of_capture(self.capture, self.device)

    @cached_property
    def _fine_template(self) -> FineTemplate | None:
        return None if self._skin is None else FineTemplate.of(self._skin.surface, self.hand, self.device)

    def _met_hand(self, index: int, mesh: PosedMesh, camera: CameraTensors) -> HandInView:
        """The same, where a surface is known."""
        hand, surface = super()._met_hand(index, mesh, camera), self._fine_mesh(index, mesh)
        if surface is None:
            return hand
        return on_surface(hand, surface, self.backend.ray_hits(surface, camera, camera.every_pixel).depth)

    def _fine_mesh(self, index: int, mesh: PosedMesh) -> FineMesh | None:
        """The known surface in the pose of an instant."""
        if self._skin is None or self._fine_template is None:
            return None
        pose = self._hand_poses[self.views[index].pose_index]
        return self._skin.posed(self._fine_template, pose, mesh, self.topology.frames, self.backend)

    def _skin_at(self, index: int, view: TrainingView) -> SeenSkin | None:
        """What an instant shows of the known skin, computed once and kept, but for depths, in half precision."""
        if self._skin is None:
            return None
        if index not in self._kept_skin:
            mesh, camera = self._fine_mesh(index, view.mesh), doubled(view.camera)
            assert mesh is not None
            seen = self.backend.seen_surface(mesh, camera)
            pixel = covered_pixels(view.rays.pixel, view.camera.size_px)
            views = view_directions(camera, pixel)
            skin = pixel_skin(pixel, views, seen, mesh, camera, self._skin.maps)
            depth, normal = self.backend.ray_hits(mesh, view.camera, view.rays.pixel)
            halved = PixelSkin(*(_halved(values) for values in skin))
            self._kept_skin[index] = SeenSkin(halved, RayHits(depth, normal.half()))
        skin, (depth, normal) = self._kept_skin[index]
        return SeenSkin(PixelSkin(*(_whole(values) for values in skin)), RayHits(depth, normal.float()))

    def _shadows(
        self,
        index: int,
        hand: HandInView,
        samples: LightSamples,
        lights: list[Light],
        position: Tensor,
        surface: Callable[[], HitSurface | None],
    ) -> tuple[LightShadows, PointShadows, SurroundingLight | None]:
        """The shadows of an instant, computed once and kept in a byte each; and the light of what stands around."""
        if index not in self._kept_light:
            occluders = occluding_triangles(lights[0], self.device)
            of_cells = sky_shadows(self.backend, hand, occluders, position)
            of_sky = with_parts(of_cells, samples.sky, self.backend, hand, occluders, position)
            white = torch.ones(3, device=self.device)  # `step.render_view` knows better
            known = surface()
            skins = None if known is None else known.lamp_skins(is_finest=True)
            shadows = light_shadows(self.backend, hand, samples, occluders, position, of_sky, white, lamp_skins=skins)
            open_sky, around = of_cells, None
            if len(occluders):
                open_sky = sky_shadows(self.backend, hand, NO_OCCLUDERS.to(self.device), position)
                around = surrounding_light(self.backend, hand, samples, lights[0])
            kept = [_packed(one) for one in (shadows.sky, shadows.lamps, open_sky)]
            self._kept_light[index] = (*kept, shadows.probes, around)
        sky, lamps, open_sky, probes, around = self._kept_light[index]
        return LightShadows(_unpacked(sky), _unpacked(lamps), probes), _unpacked(open_sky), around

    def move_pose(self, pose_index: int, theta: Tensor, vertices: Tensor) -> None:
        """As in `TrainingViews`; shadows and skin are computed again, too."""
        super().move_pose(pose_index, theta, vertices)
        self._hand_poses[pose_index] = replace(self._hand_poses[pose_index], theta=theta.detach().cpu().numpy())
        for index, view in enumerate(self.views):
            if view.pose_index == pose_index:
                self._kept_light.pop(index, None)
                self._kept_skin.pop(index, None)


def mixed(view: TrainingView, generator: torch.Generator) -> TrainingView:
    """The view in one mixture of its light groups, drawn from the generator; its target becomes that mixture."""
    light = view.light
    weights = group_weights(len(light.targets), generator).to(light.targets.device)
    lamps = light.lamps._replace(rgb=light.lamps.rgb * weights[light.group_of_lamp])
    sky = SkySamples.mixed(light.skies, weights)
    linear = torch.einsum("gchw,gc->chw", light.targets, weights)
    samples = LightSamples(sky, lamps)
    exposure = exposure_of(linear, light.alpha, LEAST_LIT * samples.unblocked(light.position.mean(0)))
    mixture = MixedLight(
        samples, light.shadows, light.open_sky, light.position, light.places, exposure, light.skin, light.around
    )
    target = torch.cat([mixture.encoded(linear), light.alpha[None]])
    return view._replace(light=mixture, target=target)


def group_weights(count: int, generator: torch.Generator) -> Float[Tensor, "G 3"]:
    """Random weights of light groups; one at least is not zero."""
    gain = torch.exp(_GAIN_SPREAD * torch.randn(count, 1, generator=generator))
    colour = torch.exp(_COLOUR_SPREAD * torch.randn(count, 3, generator=generator))
    stays = torch.rand(count, generator=generator) >= _LEFT_OUT
    stays[torch.randint(count, (), generator=generator)] = True
    return gain * colour * stays[:, None]


def exposure_of(
    linear: Float[Tensor, "3 H W"], alpha: Float[Tensor, "H W"], darkest: Float[Tensor, ""]
) -> Float[Tensor, ""]:
    """As `evaluation.exposure.exposure_gain`, of tensors; what is darker than `darkest` is exposed as that would be."""
    values = linear[:, alpha > 0.5].flatten()
    if not len(values):
        return linear.new_ones(())
    brightest = values.kthvalue(max(1, round(WHITE_SHARE / 100 * len(values)))).values
    return WHITE / brightest.maximum(darkest).clamp(min=1e-6)


def _instants(views: Iterable[CaptureView]) -> list[tuple[CaptureView, ...]]:
    """The views by pose and camera."""

    def instant(view: CaptureView) -> tuple[int, int]:
        return view.pose_index, view.camera_index

    return [tuple(group) for _, group in groupby(sorted(views, key=instant), instant)]


def _check_occluders(capture: Capture, instants: list[tuple[CaptureView, ...]]) -> None:
    for group in instants:
        first, *others = (capture.light_of(view) for view in group)
        if any(not np.array_equal(first.occluders, other.occluders) for other in others if first and other):
            raise LiveHandError(
                f"images of one pose and camera must have the same occluders, got others in {group[0].file} than in "
                f"{group[1].file}; give them different camera indices"
            )


def _halved(values: Tensor) -> Tensor:
    """In half precision; whole numbers as they are."""
    return values.half() if values.is_floating_point() else values


def _whole(values: Tensor) -> Tensor:
    return values.float() if values.is_floating_point() else values


def _packed(shadows: PointShadows) -> tuple[Tensor, Tensor]:
    """A byte for each share and depth."""
    return (shadows.lit * 255).round().byte(), (shadows.depth_in_m * (255 / MAX_DEPTH_IN_M)).round().byte()


def _unpacked(packed: tuple[Tensor, Tensor]) -> PointShadows:
    lit, depth_in = packed
    return PointShadows(lit.float() / 255, depth_in.float() * (MAX_DEPTH_IN_M / 255))
