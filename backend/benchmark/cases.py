"""What is compared: the avatar in both precisions, the paper's in both, and the paper's renderer as published."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from ..avatars.file import load_avatar
from ..hand.model import HandModel
from ..nerf.avatar import PRESETS, Avatar, new_avatar
from ..nerf.backend import Precision, Stage
from ..records.errors import LiveHandError
from ..records.shot import Frame, Shot
from ..rendering.renderer import Renderer
from ..rendering.srgb import linear_to_srgb
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
        avatar: whose networks run.
        precision: of the networks.
        render: shot and `on_stage` -> frame.
    """

    name: str
    avatar: Avatar
    precision: Precision
    render: Render

    @property
    def is_paper(self) -> bool:
        """Whether it is one of the paper's."""
        return not self.name.startswith("default")


def load_configurations(
    hand: HandModel, device: torch.device, avatar: Path | None, paper_avatar: Path | None
) -> list[Configuration]:
    """All of them, each with networks of its own; an avatar of None is the shipped one, or an untrained paper one.

    Raises:
        LiveHandError: an avatar cannot be read, is of another hand, or the paper's is not of the paper's networks.
    """
    found = [_of_renderer(f"default_{p}", load_avatar(avatar), hand, device, p) for p in PRECISIONS]
    found += [_of_renderer(f"paper_{p}", load_paper_avatar(hand, paper_avatar), hand, device, p) for p in PRECISIONS]
    published = PublishedRenderer(load_paper_avatar(hand, paper_avatar), hand, device)
    return [*found, Configuration(PUBLISHED, published.avatar, "fp32", published.render)]


def load_paper_avatar(hand: HandModel, path: Path | None) -> Avatar:
    """A trained avatar of the `paper` configuration, or an untrained one: the time is the same.

    Raises:
        LiveHandError: it is of another configuration.
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
    """Pose and render one frame; what each stage took."""
    stopwatch.begin("pose")
    frame = render(shot_of(), stopwatch.begin)
    return stopwatch.stop(), frame


def timed_write(frame: Frame, stopwatch: Stopwatch) -> Cost:
    """Encode and save one frame as PNG."""
    with tempfile.TemporaryDirectory() as folder:
        stopwatch.begin(WRITE)
        write_png(frame, Path(folder) / "frame.png")
        return stopwatch.stop()[WRITE]


def write_png(frame: Frame, path: Path) -> None:
    """8 bits, sRGB-encoded, straight alpha, through Pillow."""
    alpha = torch.as_tensor(frame.alpha)[..., None]
    straight = torch.as_tensor(frame.rgb) / torch.where(alpha > 0, alpha, torch.ones_like(alpha))
    encoded = torch.cat([linear_to_srgb(straight.clamp(0, 1)), alpha], -1)
    Image.fromarray((encoded * 255 + 0.5).numpy().astype(np.uint8), "RGBA").save(path)


def frame_cost(stages: Stages) -> Cost:
    """Pose to RGBA: all stages but the file's writing and what Cycles needs to synchronise with its scene."""
    return total({stage: cost for stage, cost in stages.items() if stage not in (WRITE, SYNC)})


def _of_renderer(
    name: str, avatar: Avatar, hand: HandModel, device: torch.device, precision: Precision
) -> Configuration:
    renderer = Renderer(avatar, hand, device.type, precision)

    def render(shot: Shot, on_stage: Callable[[Stage], None]) -> Frame:
        return renderer.render(shot, on_stage=on_stage)

    return Configuration(name, avatar, precision, render)
