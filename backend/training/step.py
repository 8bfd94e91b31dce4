"""One step of training: render views, compute their loss, and update the weights."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from ..avatars.avatar import Avatar
from ..capture.capture import CaptureView
from ..compute.precision import Precision, autocast
from ..compute.reference import ReferenceBackend
from ..field.rays import HandInView
from ..field.relightable import RelightableField
from ..field.volume import Composite
from ..image.maps import image_of, low_resolution_maps
from ..image.superres import NoSuperRes
from ..records.errors import LiveHandError
from ..render.gbuffer import RelightableNetworks
from ..render.primary_hits import skin_at_full_size
from .config import TrainConfig
from .lit_views import MixedLight, mixed
from .losses import PerceptualDistance, crop_loss
from .parts import Correction, Rendered, TrainedParts, set_rates
from .processes import ComputeSetup
from .schedule import Clock, ScheduleState, views_of_step
from .views import TrainingView, TrainingViews

_MAX_NAMED_FILES = 5


class StepResult(NamedTuple):
    """The outcome of a step.

    Attributes:
        terms: the terms of the loss by name, and `total`; means over the step's views.
        faulty_files: images with a non-finite loss or gradient; if there are any, the weights were not changed.
    """

    terms: dict[str, float]
    faulty_files: tuple[str, ...]


class SkippedSteps:
    """Counts successive skipped steps, and stops training after too many.

    Args:
        limit: number of successive skipped steps at which training stops.
    """

    def __init__(self, limit: int):
        self._limit = limit
        self._files: list[tuple[str, ...]] = []

    def update(self, faulty_files: tuple[str, ...]) -> None:
        """Count a step, which was skipped if it has faulty files.

        Raises:
            LiveHandError: the limit is reached.
        """
        self._files = [*self._files, faulty_files] if faulty_files else []
        if len(self._files) < self._limit:
            return
        names = list(dict.fromkeys(name for files in self._files for name in files))
        hidden = len(names) - _MAX_NAMED_FILES
        shown = ", ".join(names[:_MAX_NAMED_FILES]) + (f" and {hidden} more" if hidden > 0 else "")
        raise LiveHandError(
            f"losses and gradients must be finite, got none in {self._limit} steps, with the images {shown}; look at "
            "their poses and cameras in the capture; if all images are concerned, try --precision fp32"
        )


@dataclass(frozen=True)
class Stepper:
    """Runs training steps.

    Attributes:
        avatar: has the networks of `parts`.
        parts: everything that is trained.
        optimiser: of the parts.
        views: the training images.
        config: settings of the optimisation.
        compute: where training runs.
        clock: counts the time spent waiting for images.
        perceptual: the perceptual distance; None leaves that term out.
        corrections: of the capture, in the order in which they are applied.
    """

    avatar: Avatar
    parts: TrainedParts
    optimiser: torch.optim.Optimizer
    views: TrainingViews
    config: TrainConfig
    compute: ComputeSetup
    clock: Clock
    perceptual: PerceptualDistance | None = None
    corrections: tuple[Correction, ...] = ()

    def train_step(self, state: ScheduleState) -> StepResult:
        """Render the step's views, compute the loss, and update the weights unless something is not finite."""
        set_rates(self.optimiser, state.rate_factor)
        self.optimiser.zero_grad(set_to_none=True)
        for correction in self.corrections:
            correction.begin(self.views, state)
        visits = views_of_step(state.step, len(self.views), self.config)
        terms, losses = self._backward(visits, state)
        self.compute.processes.sum_gradients(self.parts.parameters())
        faulty = [visit for visit, loss in zip(visits, losses, strict=True) if not isfinite(loss)]
        if not faulty and not _has_finite_gradients(self.parts):
            faulty = visits
        if not faulty:
            self.optimiser.step()
        return StepResult(terms, tuple(self.views.views[index].file for index, _ in faulty))

    def _backward(self, visits: list[tuple[int, int]], state: ScheduleState) -> tuple[dict[str, float], list[float]]:
        """Add this process's share to the gradients; returns the mean terms and the loss of each visit."""
        means: dict[str, Tensor] = {}
        losses = torch.zeros(len(visits), device=self.compute.device)
        for place in self.compute.processes.share(range(len(visits))):
            loss, terms = self._loss(*visits[place], state)
            (loss / len(visits)).backward()
            losses[place] = loss.detach()
            for name, value in {**terms, "total": loss}.items():
                means[name] = means.get(name, 0) + value.detach().float() / len(visits)
        summed = self.compute.processes.sum(torch.cat([losses, torch.stack(list(means.values()))])).tolist()
        return dict(zip(means, summed[len(visits) :], strict=True)), summed[: len(visits)]

    def _loss(self, index: int, jitter: int, state: ScheduleState) -> tuple[Tensor, dict[str, Tensor]]:
        """Compute the loss of one view, and its terms by name."""
        view, source = self.views.get(index, jitter), self.views.views[index]
        self.clock.waiting_s = self.views.waited_s
        generator = torch.Generator().manual_seed(hash((self.config.seed, state.step, index)) % 2**63)
        if view.light is not None:
            view = mixed(view, generator)
        for correction in self.corrections:
            view = correction.before(view, source)
        rendered = self._rendered(view, source)
        perceptual = self.perceptual if state.perceptual_factor > 0 else None
        factor, config = state.perceptual_factor, self.config.loss
        with self._autocast():
            terms = crop_loss(*rendered, view.target, view.is_inside, config, perceptual, factor, generator)
        penalties = {name: value for correction in self.corrections for name, value in correction.penalty().items()}
        return sum(penalties.values(), terms.total), {**terms._asdict(), **penalties}

    def _rendered(self, view: TrainingView, source: CaptureView) -> Rendered:
        low, image = render_view(self.avatar, self.views, view, self.compute.precision)
        rendered = Rendered(low.float(), image.float())
        for correction in self.corrections:
            rendered = correction.after(rendered, source)
        return rendered

    def _autocast(self) -> torch.autocast:
        return autocast(self.compute.device, self.compute.precision)


def render_view(avatar: Avatar, views: TrainingViews, view: TrainingView, precision: Precision = "fp32") -> Rendered:
    """Render the crop of a training view.

    Raises:
        LiveHandError: the avatar is relightable, and the view's light is not known.
    """
    if isinstance(avatar.field, RelightableField) and view.light is None:
        raise LiveHandError(
            f"the relightable avatar '{avatar.name}' needs to know the light of every image, got one without; capture "
            "with --lights varied, or use an avatar with baked light"
        )
    hand = HandInView(view.mesh, views.topology, view.camera)
    with autocast(views.device, precision):
        composite = views.backend.shade(avatar.field, view.rays, hand, view.conditions, avatar.config.sampler.shell_m)
        if not isinstance(avatar.field, RelightableField):
            maps, _ = low_resolution_maps(composite, view.rays.pixel, view.camera.size_px)
            scale = avatar.config.superres.scale
            image, _ = image_of(avatar.superres, composite, view.rays.pixel, view.camera.size_px, scale)
            if isinstance(avatar.superres, NoSuperRes):
                return Rendered(avg_pool2d(image[None], 2)[0], image)
            return Rendered(torch.cat([maps[:3], maps[-1:]]), image)
    networks = RelightableNetworks.of(avatar.field, avatar.superres, ReferenceBackend(), precision)
    return _render_lit(networks, composite, hand, view, views.backend)


def _render_lit(
    networks: RelightableNetworks, gathered: Composite, hand: HandInView, view: TrainingView, backend: ReferenceBackend
) -> Rendered:
    """Decode gathered rays and light them; colours are exposed and sRGB-encoded as the view's target.

    The hand may be refined since its rays were traced: then where they met it and its shadows are of before.
    """
    light: MixedLight = view.light
    met, surface, size_px = light.met, light.surface, view.camera.size_px
    gathered = gathered._replace(channels=gathered.channels.float())
    rays = networks.decoded(met, gathered, light.visibility.sky_visibility)
    features = light.visibility.with_albedo(rays.mean_albedo).features(rays.points, backend)
    coloured = rays.low._replace(channels=light.encoded(rays.colours(features)))
    maps, _ = low_resolution_maps(coloured, met.pixel, size_px)
    image = networks.enlarged(met, rays, skin_at_full_size(backend, hand, None))
    alpha = image.alpha  # of the avatar's surface, too: else its density would learn nothing
    image = image if surface is None else surface.detailed(image)
    colours = light.encoded(networks.backend.shade_image(image, features, met.pixel, size_px))
    return Rendered(maps, torch.cat([colours, alpha[None]]))


def _has_finite_gradients(parts: TrainedParts) -> bool:
    """Return whether the norm of the gradients is finite, which it is if all gradients are."""
    gradients = [p.grad for p in parts.parameters() if p.grad is not None]
    return bool(torch.nn.utils.get_total_norm(gradients).isfinite())
