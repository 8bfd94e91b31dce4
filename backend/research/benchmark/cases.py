"""What is compared: the avatar and the paper's networks, each in both precisions, and the paper as published."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from ...avatars.avatar import PRESETS, Avatar, new_avatar
from ...avatars.file import load_avatar
from ...compute.precision import Precision
from ...field.sampler import SamplerConfig
from ...hand.model import HandModel
from ...image.frame_writer import write_png
from ...records.errors import LiveHandError
from ...records.frame import Frame
from ...records.render_hooks import Stage
from ...records.shot import Shot
from ...render.renderer import Renderer
from .published import PublishedRenderer
from .stopwatch import Cost, Stages, Stopwatch, total

WRITE = "write"
SYNC = "sync"
PUBLISHED = "published"
PRECISIONS: tuple[Precision, ...] = ("bf16", "fp32")

Render = Callable[[Shot, Callable[[Stage], None]], Frame]


@dataclass(frozen=True)
class Configuration:
    """One way to render.

    Attributes:
        name: `default_bf16`, `default_fp32`, `paper_bf16`, `paper_fp32` or `published`.
        avatar: the networks.
        precision: of the networks.
        render: (shot, `on_stage`) -> frame.
        sampler: how its rays are sampled.
    """

    name: str
    avatar: Avatar
    precision: Precision
    render: Render
    sampler: SamplerConfig

    @property
    def is_paper(self) -> bool:
        """Whether the networks are the paper's."""
        return not self.name.startswith("default")


def load_configurations(
    hand: HandModel, device: torch.device, avatar: Path | None, paper_avatar: Path | None
) -> list[Configuration]:
    """Load all configurations, each with its own networks.

    Args:
        hand: of the avatars.
        device: to render on.
        avatar: its file; None: the shipped avatar.
        paper_avatar: an avatar with the paper's networks; None: an untrained one.

    Raises:
        LiveHandError: an avatar cannot be read, is of another hand, or `paper_avatar` has other networks.
    """
    ours = [_configuration(f"default_{p}", load_avatar(avatar), hand, device, p) for p in PRECISIONS]
    paper = [_configuration(f"paper_{p}", load_paper_avatar(hand, paper_avatar), hand, device, p) for p in PRECISIONS]
    published = PublishedRenderer(load_paper_avatar(hand, paper_avatar), hand, device)
    sampler = published.avatar.config.sampler
    return [*ours, *paper, Configuration(PUBLISHED, published.avatar, "fp32", published.render, sampler)]


def load_paper_avatar(hand: HandModel, path: Path | None) -> Avatar:
    """Load a trained avatar of the `paper` configuration, or make an untrained one, which takes the same time.

    Raises:
        LiveHandError: the avatar is of another configuration.
    """
    if path is None:
        return new_avatar("untrained", hand.name, hand.sha256, PRESETS["paper"])
    avatar = load_avatar(path)
    kinds = avatar.config.field.kind, avatar.config.superres.kind
    if kinds != ("paper", "paper"):
        raise LiveHandError(
            f"--paper-avatar must be trained with --config paper, {path} has a {kinds[0]} field and a {kinds[1]} "
            "super-resolution; leave it out to time untrained networks"
        )
    return avatar


def timed_frame(shot_of: Callable[[], Shot], render: Render, stopwatch: Stopwatch) -> tuple[Stages, Frame]:
    """Pose and render one frame; returns the cost of each stage."""
    stopwatch.begin("pose")
    frame = render(shot_of(), stopwatch.begin)
    return stopwatch.stop(), frame


def timed_write(frame: Frame, stopwatch: Stopwatch) -> Cost:
    """Encode one frame as PNG and save it."""
    with tempfile.TemporaryDirectory() as folder:
        stopwatch.begin(WRITE)
        write_png(frame, Path(folder) / "frame.png")
        return stopwatch.stop()[WRITE]


def frame_cost(stages: Stages) -> Cost:
    """Sum from pose to RGBA: all stages except writing the file and Cycles' synchronisation with its scene."""
    return total({stage: cost for stage, cost in stages.items() if stage not in (WRITE, SYNC)})


def _configuration(
    name: str, avatar: Avatar, hand: HandModel, device: torch.device, precision: Precision
) -> Configuration:
    renderer = Renderer(avatar, hand, device.type, precision)

    def render(shot: Shot, on_stage: Callable[[Stage], None]) -> Frame:
        renderer.forget()  # else a hand that was rendered to warm up would only be lit
        return renderer.render(shot, on_stage=on_stage)

    return Configuration(name, avatar, precision, render, renderer.sampler)
