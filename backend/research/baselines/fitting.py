"""The optimisation of a network that is no avatar: the avatars' schedule, checkpoints and clock, around any loss."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from json import dumps
from pathlib import Path
from time import process_time

import torch
from torch import Tensor, nn
from tqdm import tqdm

from ...capture.capture import Capture
from ...training.checkpoint import Progress, TrainState, checkpoint_path, load_checkpoint, save_checkpoint
from ...training.config import TrainConfig
from ...training.parts import set_rates
from ...training.schedule import Clock, Interval, Schedule, ScheduleState
from ...training.step import SkippedSteps
from .weights_file import FILE

StepLoss = Callable[[ScheduleState], tuple[Tensor, tuple[str, ...]]]
"""(schedule) -> the loss of a step, and the files it saw."""


def fit_network(
    network: nn.Module, step_loss: StepLoss, config: TrainConfig, folder: Path, identity: str, name: str
) -> Progress:
    """Do all remaining steps with Adam; seconds are processor time.

    Args:
        network: changed in place.
        step_loss: a function of the schedule alone, so that a resumed fit ends as an unbroken one.
        config: steps, rates and intervals.
        folder: of the checkpoint.
        identity: what determines the result; a checkpoint of another one is refused.
        name: for the progress bar.

    Raises:
        LiveHandError: the checkpoint is of another fit, or losses are never finite.
    """
    folder.mkdir(parents=True, exist_ok=True)
    groups = [{"params": list(network.parameters()), "initial_lr": config.learning_rate}]
    optimiser = torch.optim.Adam(groups, lr=config.learning_rate, betas=(0.9, 0.99))
    state, path = TrainState(network, nn.Module(), optimiser), checkpoint_path(folder / FILE)
    progress = load_checkpoint(path, state, identity) if path.is_file() else Progress()
    clock, schedule, skipped = Clock(progress.seconds, process_time), Schedule(config), SkippedSteps(config.max_skipped)
    interval = Interval(60 * config.checkpoint_minutes, clock)
    network.train()
    with _bar(schedule, progress, name) as bar:
        while not schedule.is_over(progress.step, progress.seconds):
            loss, files = _step(network, optimiser, step_loss, schedule.at(progress.step, progress.seconds))
            is_finite = bool(loss.isfinite())
            skipped.update(() if is_finite else files)
            done = schedule.done(progress.step, progress.seconds)
            progress = Progress(progress.step + 1, clock.total_s, progress.skipped + (not is_finite))
            bar.update(schedule.done(progress.step, progress.seconds) - done)
            bar.set_postfix(loss=f"{float(loss):.4f}", refresh=False)
            if progress.step % config.checkpoint_every == 0 or interval.is_due():
                save_checkpoint(path, state, progress, identity)
    save_checkpoint(path, state, progress, identity)
    network.eval()
    return progress


def identity_of(capture: Capture, config: TrainConfig, views: Sequence, kind: str, version: int) -> str:
    """Collect what determines the result of a fit."""
    return dumps([kind, version, asdict(config), capture.provenance, len(views)])


def _step(
    network: nn.Module, optimiser: torch.optim.Optimizer, step_loss: StepLoss, state: ScheduleState
) -> tuple[Tensor, tuple[str, ...]]:
    """Take one step; nothing changes unless loss and gradients are finite."""
    set_rates(optimiser, state.rate_factor)
    optimiser.zero_grad(set_to_none=True)
    loss, files = step_loss(state)
    loss.backward()
    gradients = [p.grad for p in network.parameters() if p.grad is not None]
    norm = torch.nn.utils.get_total_norm(gradients)
    if bool(loss.isfinite() & norm.isfinite()):
        optimiser.step()
        return loss.detach(), files
    return torch.full_like(loss.detach(), torch.nan), files


def _bar(schedule: Schedule, progress: Progress, name: str) -> tqdm:
    unit = "step" if schedule.config.minutes is None else "core-s"
    return tqdm(
        total=round(schedule.total), initial=int(schedule.done(progress.step, progress.seconds)), unit=unit, desc=name
    )
