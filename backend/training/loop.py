"""Fits an avatar to a capture: the main road of training."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, replace
from math import cos, pi
from pathlib import Path

import torch
from torch import Tensor, nn
from tqdm import tqdm

from ..avatar import Avatar, AvatarConfig, new_avatar, save_avatar
from ..capture import Capture
from ..errors import LiveHandError
from ..field.encoding import FeaturePlane
from ..hand.model import HandModel
from ..image import image_of, low_resolution_maps
from ..renderer import Precision
from ..shading import shade
from .checkpoint import checkpoint_path, load_checkpoint, save_checkpoint
from .config import TrainConfig
from .losses import window_loss
from .perceptual import PerceptualDistance
from .views import TrainingView, TrainingViews

LOGGER = logging.getLogger(__name__)


def train(
    capture: Capture,
    hand: HandModel,
    output: Path,
    config: TrainConfig,
    avatar_config: AvatarConfig,
    perceptual: PerceptualDistance | None,
    device: torch.device,
    precision: Precision = "fp32",
    resume: bool = False,
) -> Avatar:
    """Train an avatar and save it to `output`; `resume` goes on from its checkpoint.

    Raises:
        LiveHandError: the capture is of another hand, has no training images, or the checkpoint is of another run.
    """
    avatar = new_avatar(output.stem, hand.name, hand.sha256, avatar_config, config.seed)
    networks = nn.ModuleList([avatar.field, avatar.superres]).to(device).train()
    views = TrainingViews(capture, capture.of_split("train"), hand, avatar_config.sampler, device, config.seed)
    if not len(views):
        raise LiveHandError(f"capture {capture.folder} must have training images that show the hand, got none")
    optimiser = _optimiser(networks, config)
    perceptual = perceptual.to(device) if perceptual is not None else None
    run = json.dumps([asdict(config), asdict(avatar_config), capture.provenance, len(views), precision])
    checkpoint = checkpoint_path(output)
    first = load_checkpoint(checkpoint, networks, optimiser, run) if resume and checkpoint.is_file() else 0
    with tqdm(total=config.steps, initial=first, unit="step", desc="train") as progress:
        for step in range(first, config.steps):
            loss = _train_step(avatar, views, optimiser, config, perceptual, step, device, precision)
            progress.update()
            progress.set_postfix_str(f"loss {loss:.4f}", refresh=False)
            if (step + 1) % config.checkpoint_every == 0:
                save_checkpoint(checkpoint, networks, optimiser, step + 1, run)
                LOGGER.info("step %d loss %.5f", step + 1, loss)
    avatar = replace(avatar, provenance=_provenance(capture, config, precision))
    save_avatar(avatar, output)
    return avatar


def _train_step(
    avatar: Avatar,
    views: TrainingViews,
    optimiser: torch.optim.Optimizer,
    config: TrainConfig,
    perceptual: PerceptualDistance | None,
    step: int,
    device: torch.device,
    precision: Precision,
) -> float:
    for group in optimiser.param_groups:
        group["lr"] = group["initial_lr"] * rate_at(step, config)
    training_view = views.get(*view_of_step(step, len(views), config))
    is_perceptual = step >= config.steps * (1 - config.loss.perceptual_share)
    with torch.autocast(device.type, torch.bfloat16, enabled=precision == "bf16"):
        low, image = render_view(avatar, views, training_view)
        loss = window_loss(
            low.float(),
            image.float(),
            training_view.target,
            training_view.is_inside,
            config.loss,
            perceptual if is_perceptual else None,
        ).total
    optimiser.zero_grad(set_to_none=True)
    loss.backward()
    optimiser.step()
    return loss.item()


def render_view(avatar: Avatar, views: TrainingViews, view: TrainingView) -> tuple[Tensor, Tensor]:
    """RGBA of a training view's window before [4, h, w] and after [4, 2h, 2w] super-resolution."""
    shell_m = avatar.config.sampler.shell_m
    composite = shade(avatar.field, view.rays, views.topology, view.conditions, view.mesh.scale, view.view, shell_m)
    maps, _ = low_resolution_maps(composite, view.rays.pixel, view.view.size_px)
    image, _ = image_of(avatar.superres, composite, view.rays.pixel, view.view.size_px)
    return torch.cat([maps[:3], maps[-1:]]), image


def rate_at(step: int, config: TrainConfig) -> float:
    """Share of the learning rates at a step: linear warm-up, then cosine decay."""
    warmup = min(1.0, (step + 1) / config.warmup_steps)
    decay = 0.5 * (1 + cos(pi * step / config.steps))
    return warmup * (config.final_learning_rate + (1 - config.final_learning_rate) * decay)


def view_of_step(step: int, view_count: int, config: TrainConfig) -> tuple[int, int]:
    """(image, jitter set) of a step: every epoch all images once, in an order drawn from (seed, epoch)."""
    epoch, position = divmod(step, view_count)
    generator = torch.Generator().manual_seed(config.seed * 100_003 + epoch)
    order = torch.randperm(view_count, generator=generator)
    return int(order[position]), epoch % config.jitter_sets


def _optimiser(networks: nn.Module, config: TrainConfig) -> torch.optim.Optimizer:
    planes = [module.table for module in networks.modules() if isinstance(module, FeaturePlane)]
    is_plane = {id(table) for table in planes}
    others = [parameter for parameter in networks.parameters() if id(parameter) not in is_plane]
    groups = [{"params": others, "initial_lr": config.learning_rate}]
    if planes:
        groups.append({"params": planes, "initial_lr": config.plane_learning_rate})
    return torch.optim.Adam(groups, lr=config.learning_rate, betas=(0.9, 0.99), eps=1e-8, fused=True)


def _provenance(capture: Capture, config: TrainConfig, precision: Precision) -> dict:
    return {
        "made_by": "livehand train",
        "training": asdict(config),
        "precision": precision,
        "capture": capture.provenance,
        "licence": config.licence,
    }
