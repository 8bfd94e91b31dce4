"""Training images of a relightable avatar: each instant in all of its light groups, mixed anew at every step.

A light group, a photograph in one lamp and one in an environment are each an image in one light. Light adds up, so any
mixture of the images of one instant shows the hand in the same mixture of their lights: exact, free variety.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..capture.capture import Capture, CaptureView
from ..compute.reference import ReferenceBackend
from ..evaluation.exposure import LEAST_LIT, WHITE, WHITE_SHARE
from ..field.rays import CameraTensors, HandInView
from ..field.sampler import SamplerConfig
from ..geometry.mesh import PosedMesh
from ..hand.model import HandModel
from ..image.srgb import linear_to_srgb
from ..records.errors import LiveHandError
from ..records.light import Light
from ..records.shot import HandPose
from ..render.avatar_surface import skin_of_capture
from ..render.light_groups import LightGroups
from ..render.light_visibility import (
    NO_OCCLUDERS,
    LightVisibility,
    PackedVisibility,
    light_visibility,
    sky_shadows,
)
from ..render.posed_surface import SurfacePixels, SurfacePoser
from ..render.primary_hits import LampShadowCasters, PrimaryHits, primary_hits
from .crop_store import CropStore
from .views import TrainingView, TrainingViews

_GAIN_SPREAD, _COLOUR_SPREAD = 0.7, 0.25
"""Standard deviations of a group's random gain, and of its colours against it, as natural logarithms."""
_LEFT_OUT = 0.2
"""Probability with which a group is left out, if another remains."""


class ViewLight(NamedTuple):
    """The light of one instant, in G groups.

    Attributes:
        groups: sampled.
        met: where the view's rays meet the skin.
        visibility: of all groups together at these points.
        targets: [G, 3, 2h, 2w] linear premultiplied colours.
        alpha: [2h, 2w].
        surface: what the view shows of the avatar's surface; None: it has none.
    """

    groups: LightGroups
    met: PrimaryHits
    visibility: LightVisibility
    targets: Tensor
    alpha: Tensor
    surface: SurfacePixels | None


class MixedLight(NamedTuple):
    """One mixture of the light groups.

    Attributes:
        met: where the view's rays meet the skin.
        visibility: of the mixture at these points.
        exposure: [] factor of linear colours before they are encoded.
        surface: what the view shows of the avatar's surface; None: it has none.
    """

    met: PrimaryHits
    visibility: LightVisibility
    exposure: Tensor
    surface: SurfacePixels | None

    def encoded(self, linear: Float[Tensor, "*n"]) -> Float[Tensor, "*n"]:
        """Expose and sRGB-encode; values over 1 continue the curve."""
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
        self._kept_light: dict[int, PackedVisibility] = {}
        self._kept_surface: dict[int, SurfacePixels] = {}
        self._hand_poses = list(capture.poses)

    def get(self, index: int, jitter: int) -> TrainingView:
        """Return instant `index` with its `jitter`-th set of samples, and its light before it is mixed."""
        view = super().get(index, jitter)
        return view._replace(light=self._light(index, view))

    def _visibility(self, mesh: PosedMesh) -> Tensor:
        """Return None: shadows come with the light."""
        return mesh.vertices.new_zeros(len(mesh.vertices), 0)

    def _target(self, index: int) -> Float[Tensor, "4 H W"]:
        """Return alpha alone: colours depend on how the light is mixed."""
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
        hand, surface = HandInView(view.mesh, self.topology, view.camera), self._surface_in(index, view)
        hits = None if surface is None else surface.hits
        met = primary_hits(self.backend, hand, view.rays, hits, None, ReferenceBackend().mesh_points)
        groups, linear = LightGroups.of(lights, view.mesh), self._linear(index)
        return ViewLight(
            groups=groups,
            met=met,
            visibility=self._visibility_in(index, met, lights[0], groups),
            targets=linear[:, :3],
            alpha=linear[0, 3],
            surface=surface,
        )

    @cached_property
    def _surface(self) -> SurfacePoser | None:
        skin = skin_of_capture(self.capture, self.device)
        return None if skin is None else SurfacePoser(skin, self.hand, self.device, self.backend)

    def _met_hand(self, index: int, mesh: PosedMesh, camera: CameraTensors) -> HandInView:
        """Return the hand as rays meet it, on the avatar's surface if it has one."""
        hand = super()._met_hand(index, mesh, camera)
        return hand if self._surface is None else self._surface.in_view(self._pose(index), hand).met(hand)

    def _pose(self, index: int) -> HandPose:
        return self._hand_poses[self.views[index].pose_index]

    def _surface_in(self, index: int, view: TrainingView) -> SurfacePixels | None:
        """Return what an instant shows of the avatar's surface, computed once and kept in half precision."""
        if self._surface is None:
            return None
        if index not in self._kept_surface:
            mesh = self._surface.mesh(self._pose(index), view.mesh, self.topology.frames)
            shown = self._surface.shown(mesh, view.camera, view.rays.pixel, self._pose(index).side)
            self._kept_surface[index] = shown.halved()
        return self._kept_surface[index].whole()

    def _visibility_in(self, index: int, met: PrimaryHits, light: Light, groups: LightGroups) -> LightVisibility:
        """Return the visibility at the points of an instant, computed once and kept in a byte each."""
        samples = groups.together()
        if index not in self._kept_light:
            sky_visibility = sky_shadows(self.backend, met.hand, NO_OCCLUDERS.to(self.device), met.position)
            white = torch.ones(3, device=self.device)  # `step.render_view` knows better
            visibility = light_visibility(
                self.backend,
                met.hand,
                light,
                samples,
                met.position,
                sky_visibility,
                white,
                None,
                self._casters(index, met),
            )
            self._kept_light[index] = visibility.packed()
        return self._kept_light[index].unpacked(samples)

    def _casters(self, index: int, met: PrimaryHits) -> LampShadowCasters | None:
        """Choose the skins of the avatar's surface that cast lamps' shadows; None: it has none, the mesh casts them."""
        if self._surface is None:
            return None
        mesh = self._surface.mesh(self._pose(index), met.hand.mesh, self.topology.frames)
        return met.on_surface(mesh).shadow_casters(is_finest=True)

    def move_pose(self, pose_index: int, theta: Tensor, vertices: Tensor) -> None:
        """Replace a pose as `TrainingViews` does; shadows and surface are computed again, too."""
        super().move_pose(pose_index, theta, vertices)
        self._hand_poses[pose_index] = replace(self._hand_poses[pose_index], theta=theta.detach().cpu().numpy())
        for index, view in enumerate(self.views):
            if view.pose_index == pose_index:
                self._kept_light.pop(index, None)
                self._kept_surface.pop(index, None)


def mixed(view: TrainingView, generator: torch.Generator) -> TrainingView:
    """Mix the view's light groups with weights drawn from the generator; its target becomes that mixture."""
    light = view.light
    weights = group_weights(len(light.targets), generator).to(light.targets.device)
    linear = torch.einsum("gchw,gc->chw", light.targets, weights)
    samples = light.groups.mixed(weights)
    exposure = exposure_of(linear, light.alpha, LEAST_LIT * samples.unblocked(light.met.position.mean(0)))
    mixture = MixedLight(light.met, light.visibility.lit_by(samples), exposure, light.surface)
    target = torch.cat([mixture.encoded(linear), light.alpha[None]])
    return view._replace(light=mixture, target=target)


def group_weights(count: int, generator: torch.Generator) -> Float[Tensor, "G 3"]:
    """Draw random weights of light groups; one at least is not zero."""
    gain = torch.exp(_GAIN_SPREAD * torch.randn(count, 1, generator=generator))
    colour = torch.exp(_COLOUR_SPREAD * torch.randn(count, 3, generator=generator))
    stays = torch.rand(count, generator=generator) >= _LEFT_OUT
    stays[torch.randint(count, (), generator=generator)] = True
    return gain * colour * stays[:, None]


def exposure_of(
    linear: Float[Tensor, "3 H W"], alpha: Float[Tensor, "H W"], darkest: Float[Tensor, ""]
) -> Float[Tensor, ""]:
    """Compute `evaluation.exposure.exposure_gain` of tensors; what is darker than `darkest` is exposed as that is."""
    values = linear[:, alpha > 0.5].flatten()
    if not len(values):
        return linear.new_ones(())
    brightest = values.kthvalue(max(1, round(WHITE_SHARE / 100 * len(values)))).values
    return WHITE / brightest.maximum(darkest).clamp(min=1e-6)


def _instants(views: Iterable[CaptureView]) -> list[tuple[CaptureView, ...]]:
    """Group the views by pose and camera."""

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
