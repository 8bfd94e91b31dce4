"""What a cut of the film is, and the pictures that are drawn around a hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ... import api

Draw = Callable[[float], np.ndarray]
"""Draws the picture [H, W, 3] uint8 at a share of a cut's time, from 0 to below 1."""

_BACKDROP_TOP, _BACKDROP_BOTTOM = np.array([58, 61, 66.0]), np.array([20, 21, 24.0])
_CAPTION, _MARGIN = 0.044, 0.048  # of the height


@dataclass(frozen=True)
class FilmSet:
    """Where a film is made.

    Attributes:
        size_px: (width, height) of its pictures.
        rate: pictures a second.
        folder: keeps what is rendered, so that a film goes on where it was stopped.
    """

    size_px: tuple[int, int]
    rate: float
    folder: Path

    def over_backdrop(self, frame: api.Frame) -> np.ndarray:
        """Lay a frame [H, W] over a backdrop that darkens downwards: [H, W, 3] uint8."""
        rgba = api.srgb_pixels(frame).astype(np.float64)
        share = np.linspace(0, 1, len(rgba))[:, None, None]
        backdrop = (1 - share) * _BACKDROP_TOP + share * _BACKDROP_BOTTOM
        alpha = rgba[..., 3:] / 255
        return (alpha * rgba[..., :3] + (1 - alpha) * backdrop).round().astype(np.uint8)

    def fitted(self, picture: Image.Image, magnified: float = 1.0) -> np.ndarray:
        """Fill the film's picture with another, its middle magnified: [H, W, 3] uint8."""
        width, height = self.size_px
        scale = magnified * max(width / picture.width, height / picture.height)
        cut = np.array([width, height]) / scale
        left, top = (np.array(picture.size) - cut) / 2
        box = (left, top, left + cut[0], top + cut[1])
        return np.asarray(picture.convert("RGB").resize(self.size_px, Image.Resampling.LANCZOS, box))


class Cut(NamedTuple):
    """One part of the film.

    Attributes:
        name: of the folder that keeps its pictures.
        caption: below them.
        seconds: its length.
        prepare: loads or renders what it needs, and returns how it is drawn.
    """

    name: str
    caption: str
    seconds: float
    prepare: Callable[[FilmSet], Draw]


def side_by_side(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Show the middle half of two pictures [H, W, 3], with a line between them."""
    width = left.shape[1]
    both = np.concatenate([one[:, width // 4 : width // 4 + width // 2] for one in (left, right)], 1)
    both[:, width // 2 - 1 : width // 2 + 1] = 0
    return both


def eased(share: float) -> float:
    """Begin and end a motion at rest: 0 to 1."""
    return share * share * (3 - 2 * share)


def captioned(picture: np.ndarray, caption: str) -> np.ndarray:
    """Write a line below a picture [H, W, 3] uint8."""
    image = Image.fromarray(picture)
    draw, height = ImageDraw.Draw(image), len(picture)
    font, margin = ImageFont.load_default(_CAPTION * height), _MARGIN * height
    draw.text((margin + 1, height - margin + 1), caption, (0, 0, 0), font, "ls")
    draw.text((margin, height - margin), caption, (240, 240, 236), font, "ls")
    return np.asarray(image)
