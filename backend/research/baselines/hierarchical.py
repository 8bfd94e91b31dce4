"""The paper's ablation of mesh-guided sampling: the paper's field asked along whole rays, coarse and fine.

Rays run through the box around the hand. The coarse network is asked at even strata, the fine one also at samples drawn
by the coarse one's weights. Each sample is projected onto the nearest skin; its height is clipped at three shells,
where a field is empty or opaque. Super-resolution is the paper's.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import normalize
from torch.utils.checkpoint import checkpoint

from ...avatars.file import load_avatar
from ...capture.capture import Capture
from ...compute.precision import autocast
from ...evaluation.shot_renderer import no_stage
from ...field.conditions import FieldInputs
from ...field.field import PaperField
from ...field.near_skin import NearSkin
from ...field.rays import CameraTensors, camera_tensors, ray_directions, ray_origin
from ...field.sampler import SamplerConfig, strata
from ...field.volume import Composite
from ...geometry.mesh import PosedMesh, Topology
from ...geometry.uvh import atlas_uv
from ...hand.model import MIRROR_AXIS_ANGLE, HandModel
from ...image.crop import crop_of
from ...image.decode import decode_frame
from ...image.maps import image_of, low_resolution_maps
from ...image.superres import PaperSuperRes, SuperResConfig
from ...records.errors import LiveHandError
from ...records.frame import Frame, empty_frame
from ...records.render_hooks import OnStage
from ...records.shot import Shot
from ...training.losses import crop_loss
from ...training.schedule import ScheduleState, views_of_step
from .avatar_rows import AVATAR_FILE, FROM_THE_START
from .fitting import fit_network, identity_of
from .method import Budget, Fitted, FittingMachine
from .pixel_rays import PixelRays, composite_steps, importance_samples
from .posed_views import PosedViews, ShotMeshes
from .weights_file import load_network, parameter_count, save_method

SHELL_M = 0.005
COARSE, FINE = 32, 32
_STEP_SHARE = 0.5
_MAX_SHELLS = 3.0
_RAYS_AT_ONCE = 1024
_SAMPLER = SamplerConfig(shell_m=SHELL_M)


class HierarchicalNetworks(nn.Module):
    """The coarse and the fine field, and super-resolution."""

    def __init__(self):
        super().__init__()
        self.coarse, self.fine = PaperField(), PaperField()
        self.superres = PaperSuperRes(SuperResConfig(kind="paper"))

    def forward(
        self, rays: PixelRays, skin: NearSkin, topology: Topology, theta: Float[Tensor, " 48"], jitter: Tensor | None
    ) -> tuple[Composite, Composite]:
        """Composite the coarse and the fine field; `jitter` [R, 64] in (0, 1) moves the samples in their strata."""
        count = len(rays.near)
        even = strata(count, COARSE, rays.near, None)
        moved = even if jitter is None else even + (jitter[:, :COARSE] - 0.5) / COARSE
        t = rays.near[:, None] + moved * (rays.far - rays.near)[:, None]
        coarse = self._composite(self.coarse, rays, t, skin, topology, theta)
        at = strata(count, FINE, rays.near, None)
        at = at if jitter is None else at + (jitter[:, COARSE:] - 0.5) / FINE
        drawn = importance_samples(t, coarse.weights, rays.far, at)
        t = torch.cat([t, drawn], 1).sort(1).values
        return coarse, self._composite(self.fine, rays, t, skin, topology, theta)

    def _composite(
        self, field: nn.Module, rays: PixelRays, t: Tensor, skin: NearSkin, topology: Topology, theta: Tensor
    ) -> Composite:
        assert isinstance(field, PaperField)
        points = rays.points(t).flatten(0, 1)
        samples = skin.at(points)
        height = (samples.height_m / SHELL_M).clamp(-_MAX_SHELLS, _MAX_SHELLS)
        view = normalize(rays.directions, dim=-1)
        inputs = FieldInputs.of_paper(atlas_uv(topology, samples), height, view, theta)
        sigma, channels = field.ask(inputs, t.shape[1])
        of_rays = channels.reshape(*t.shape, -1).to(sigma.dtype)
        summed, alpha, weights = composite_steps(sigma.reshape(t.shape), of_rays, rays.steps_mm(t))
        depth = (weights * t).sum(1) / alpha.clamp(min=1e-6)
        return Composite(summed, alpha, depth, weights)


class _Scene(NamedTuple):
    """What the rays of one hand share."""

    skin: NearSkin
    topology: Topology
    theta: Tensor


def _rendered(
    networks: HierarchicalNetworks, rays: PixelRays, scene: _Scene, jitter: Tensor | None
) -> tuple[Composite, Composite]:
    """Render all rays in chunks; with gradients, a chunk's samples are computed again rather than kept."""
    parts = []
    for chunk in torch.arange(len(rays.pixel), device=rays.pixel.device).split(_RAYS_AT_ONCE):
        some = None if jitter is None else jitter[chunk]
        arguments = rays.chosen(chunk), *scene, some
        if torch.is_grad_enabled():
            parts.append(checkpoint(networks, *arguments, use_reentrant=False))
        else:
            parts.append(networks(*arguments))
    coarse, fine = zip(*parts, strict=True)
    return _joined(coarse), _joined(fine)


def _joined(parts: tuple[Composite, ...]) -> Composite:
    return Composite(*(torch.cat(values) for values in zip(*parts, strict=True)))


def box_rays(mesh: PosedMesh, camera: CameraTensors) -> PixelRays:
    """Select the rays that meet the box around the hand's shell, from where they enter it to where they leave."""
    reach = SHELL_M * mesh.scale
    low, high = mesh.vertices.amin(0) - reach, mesh.vertices.amax(0) + reach
    pixel = camera.every_pixel
    origin, directions = ray_origin(camera), ray_directions(camera, pixel)
    slope = torch.where(directions.abs() < 1e-9, torch.full_like(directions, 1e-9), directions)
    ends = torch.stack([(low - origin) / slope, (high - origin) / slope])
    near, far = ends.amin(0).amax(1).clamp(min=1e-3), ends.amax(0).amin(1)
    (index,) = torch.where(far > near)
    return PixelRays(pixel, origin, directions, near, far, mesh.scale).chosen(index)


@dataclass(frozen=True)
class Hierarchical:
    """The method."""

    name: str = "hierarchical"
    label: str = "without mesh-guided sampling (hierarchical)"
    tables: tuple[str, ...] = ("components",)
    version: int = 1
    notes: str = (
        "32 even and 32 drawn samples a ray through the hand's box, a coarse and a fine field; the published counts "
        "are not known. Half the steps of the other rows; with --inference-only the networks of row `paper`, whose "
        "field is then both the coarse and the fine one."
    )

    def fit(self, capture: Capture, hand: HandModel, budget: Budget, folder: Path, machine: FittingMachine) -> Fitted:
        """Train both fields and super-resolution, or take those of the row `paper`."""
        networks = self._networks(machine.seed).to(machine.device)
        if machine.is_inference_only:
            return self._adopted(networks, folder)
        views = PosedViews(capture, hand, machine.device, machine.seed)
        rates = {"learning_rate": 2e-3, "seed": machine.seed, "loss": FROM_THE_START}
        config = budget.train_config(_STEP_SHARE, **rates)

        def step_loss(state: ScheduleState) -> tuple[Tensor, tuple[str, ...]]:
            ((index, _),) = views_of_step(state.step, len(views), config)
            window = views.window(index)
            camera = camera_tensors(views.low_camera(index), machine.device)
            scene = _Scene(NearSkin(window.mesh, views.topology), views.topology, window.theta.flatten())
            rays = box_rays(window.mesh, camera)
            generator = torch.Generator(machine.device).manual_seed(machine.seed * 1_000_003 + state.step)
            jitter = torch.rand(len(rays.pixel), COARSE + FINE, generator=generator, device=machine.device)
            with autocast(machine.device, machine.compute.precision):
                coarse, fine = _rendered(networks, rays, scene, jitter)
                image, _ = image_of(networks.superres, fine, rays.pixel, camera.size_px, 2)
                lows = [low_resolution_maps(one, rays.pixel, camera.size_px)[0] for one in (fine, coarse)]
                low, coarse_low = (torch.cat([maps[:3], maps[-1:]]).float() for maps in lows)
                perceptual = machine.perceptual
                terms = crop_loss(low, image.float(), window.target, window.is_inside, config.loss, perceptual)
                truth = torch.nn.functional.avg_pool2d((window.target * window.is_inside)[None], 2)[0]
                inside = torch.nn.functional.avg_pool2d(window.is_inside[None].float(), 2)[0] == 1
            of_coarse = config.loss.low_l2 * (((coarse_low - truth) * inside) ** 2).mean()
            return terms.total + of_coarse, (window.file,)

        identity = identity_of(capture, config, views.views, self.name, self.version)
        progress = fit_network(networks, step_loss, config, folder, identity, self.name)
        save_method(folder, self.name, networks.state_dict())
        return Fitted(progress.step, progress.seconds / 60, parameter_count(networks))

    def load(self, folder: Path, hand: HandModel, device: torch.device) -> BoxRenderer:
        """Load the trained method."""
        networks = load_network(folder, self.name, self._networks(0)).to(device)
        assert isinstance(networks, HierarchicalNetworks)
        return BoxRenderer(hand, networks, device)

    def _adopted(self, networks: HierarchicalNetworks, folder: Path) -> Fitted:
        path = folder.parent / "paper" / AVATAR_FILE
        if not path.is_file():
            raise LiveHandError(f"--inference-only needs the trained row 'paper', got no {path}; add it to --rows")
        avatar = load_avatar(path)
        for network in (networks.coarse, networks.fine):
            network.load_state_dict(avatar.field.state_dict())
        networks.superres.load_state_dict(avatar.superres.state_dict())
        save_method(folder, self.name, networks.state_dict())
        return Fitted(0, 0.0, parameter_count(networks), "not trained: the networks of row `paper`, sampled otherwise")

    def _networks(self, seed: int) -> HierarchicalNetworks:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return HierarchicalNetworks()


class BoxRenderer:
    """Renders the networks along whole rays.

    Attributes:
        hand: the model of its shots.
    """

    def __init__(self, hand: HandModel, networks: HierarchicalNetworks, device: torch.device):
        self.hand, self._networks, self._device = hand, networks, device
        self._meshes = ShotMeshes(hand, device)

    @torch.inference_mode()
    def render(self, shot: Shot, *, on_stage: OnStage = no_stage) -> Frame:
        """Render as `ShotRenderer` does."""
        on_stage("pose")
        mesh, topology = self._meshes.mesh(shot)
        crop = crop_of(mesh, shot.camera, _SAMPLER)
        if crop is None:
            return empty_frame(shot.camera.size_px)
        camera = camera_tensors(crop.camera_of(shot.camera), self._device)
        theta = shot.pose.theta if shot.pose.side == self.hand.side else shot.pose.theta * MIRROR_AXIS_ANGLE
        theta = torch.as_tensor(theta, dtype=torch.float32, device=self._device).flatten()
        on_stage("field")
        rays = box_rays(mesh, camera)
        _, fine = _rendered(self._networks, rays, _Scene(NearSkin(mesh, topology), topology, theta), None)
        on_stage("superres")
        image, depth = image_of(self._networks.superres, fine, rays.pixel, camera.size_px, 2)
        on_stage("decode")
        return decode_frame(image.float(), depth, crop, shot.camera.size_px)


HIERARCHICAL = Hierarchical()
