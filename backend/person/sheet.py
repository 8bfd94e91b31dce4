"""A sheet for the user: pictures beside what the person's avatar shows in the same view, and how much was seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from ..capture.picture import linear_to_srgb
from ..records.light import Light
from .light import PictureLight
from .making import MadePerson
from .picture import HandPicture

_COLUMNS, _HEIGHT_PX = 6, 320
_CAPTION_PX = 18
_CONFIDENCE_PX = 2 * _HEIGHT_PX


def write_sheet(path: Path, made: MadePerson, pictures: Sequence[HandPicture], caption: str) -> None:
    """Write the sheet: a row of pictures, one of ours in the light that was found, and the confidence in the atlas."""
    chosen = [pictures[index] for index in np.linspace(0, len(pictures) - 1, min(_COLUMNS, len(pictures))).astype(int)]
    columns = [np.concatenate(_pair(made, picture, made.lights), 0) for picture in chosen]
    confidence = _confidence(made)
    whole = np.concatenate([*columns, confidence], 1)
    image = Image.new("RGB", (whole.shape[1], whole.shape[0] + _CAPTION_PX), "white")
    image.paste(Image.fromarray(whole), (0, _CAPTION_PX))
    ImageDraw.Draw(image).text((4, 3), caption, fill="black")
    image.save(path)


def _pair(made: MadePerson, picture: HandPicture, lights: Mapping[int, PictureLight]) -> list[np.ndarray]:
    light = lights[picture.scene]
    frame = made.model.rendered(picture.pose, picture.camera, Light(sky=light.light.sky))
    straight = frame.rgb / np.maximum(frame.alpha[..., None], 1e-3) * light.tint
    ours = linear_to_srgb(straight.clip(0, 1).astype(np.float32))
    blended = ours * frame.alpha[..., None] + (picture.rgb / 255) * (1 - frame.alpha[..., None])
    return [_scaled(picture.rgb), _scaled((255 * blended).clip(0, 255).astype(np.uint8))]


def _scaled(rgb: np.ndarray) -> np.ndarray:
    height, width = rgb.shape[:2]
    size = max(1, round(width * _HEIGHT_PX / height)), _HEIGHT_PX
    return np.asarray(Image.fromarray(rgb).resize(size, Image.Resampling.LANCZOS))


def _confidence(made: MadePerson) -> np.ndarray:
    """Draw the atlas: the person's colours where they were seen, grey where they are a guess."""
    texels = made.texels
    seen = made.completed.confidence[:, None]
    ratio = np.exp(made.completed.log_ratio)
    colour = linear_to_srgb((0.35 * ratio).clip(0, 1).astype(np.float32))
    image = np.full((texels.resolution**2, 3), 1.0, np.float32)
    image[texels.pixel] = seen * colour + (1 - seen) * 0.5
    upright = image.reshape(texels.resolution, texels.resolution, 3)[::-1]
    small = Image.fromarray((255 * upright).clip(0, 255).astype(np.uint8)).resize((_CONFIDENCE_PX, _CONFIDENCE_PX))
    return np.asarray(small)
