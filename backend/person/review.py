"""How well a person shows the pictures: figures of those that were kept from the fits, and a sheet for the user."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from ..capture.masks.mask import load_opencv
from ..capture.picture import linear_to_srgb, srgb_to_linear
from ..records.hand_picture import HAND, UNKNOWN, HandPicture
from ..system.files import replacing
from ..system.parallel_map import parallel_map
from .bases import family_at_base
from .lit_model.flow import flow_between
from .lit_model.illumination import Illumination, encoded_colours
from .lit_model.model import PersonModel
from .lit_model.picture_lights import PictureIlluminations
from .making import MadePerson

_CLIPPED = 0.98
_ALIGNED_ERODED_PX = 9


class PersonFigures(NamedTuple):
    """Means over pictures.

    Attributes:
        psnr_db: of sRGB-encoded colours on the hand, after the best gain of each channel.
        aligned_psnr_db: the same inside the outline, after flow.
        overlap: of outline and mask, intersection over union of what is known.
        pictures: how many there are.
    """

    psnr_db: float
    aligned_psnr_db: float
    overlap: float
    pictures: int


def held_out_figures(
    model: PersonModel, pictures: Sequence[HandPicture], lights: PictureIlluminations
) -> PersonFigures | None:
    """Measure the pictures that are held out; None: there are none."""
    held_out = [picture for picture in pictures if picture.is_held_out]
    found = parallel_map(lambda picture: _row(model, picture, lights.at(picture)), held_out)
    rows = [row for row in found if row is not None]
    if not rows:
        return None
    psnr, aligned, overlap = np.mean(rows, 0)
    return PersonFigures(float(psnr), float(aligned), float(overlap), len(rows))


def _row(model: PersonModel, picture: HandPicture, light: Illumination) -> tuple[float, float, float] | None:
    cv2 = load_opencv()
    frame = model.rendered(picture.pose, picture.camera, light.light)
    shown, is_hand = picture.rgb.astype(np.float32) / 255, picture.labels == HAND
    is_ours, is_known = frame.alpha > 0.5, picture.labels != UNKNOWN
    both = is_hand & is_ours
    if not both.any():
        return None
    linear = frame.rgb / np.maximum(frame.alpha[..., None], 1e-3)
    even = both & (shown.max(-1) < _CLIPPED)
    gain = np.exp(np.median(np.log((srgb_to_linear(shown)[even] + 1e-3) / (linear[even] + 1e-3)), 0))
    ours = linear_to_srgb((linear * gain).clip(0, 1).astype(np.float32))
    overlap = both.sum() / ((is_ours & is_known) | is_hand).sum()
    flow = flow_between(_on_grey(shown, is_hand), _on_grey(ours, is_ours), finest_level=0)
    rows, columns = np.mgrid[: shown.shape[0], : shown.shape[1]].astype(np.float32)
    aligned = cv2.remap(ours, columns + flow.px[..., 0], rows + flow.px[..., 1], cv2.INTER_LINEAR)
    inner = cv2.erode(both.astype(np.uint8), np.ones((_ALIGNED_ERODED_PX, _ALIGNED_ERODED_PX))) > 0
    on_black = ours * is_ours[..., None]
    return _psnr(on_black, shown, is_hand), _psnr(aligned, shown, inner if inner.any() else both), float(overlap)


def _on_grey(encoded: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return np.where(mask, encoded.mean(-1), 0.1)


def _psnr(ours: np.ndarray, theirs: np.ndarray, where: np.ndarray) -> float:
    return float(-10 * np.log10(max(((ours - theirs)[where] ** 2).mean(), 1e-9)))


_COLUMNS, _HEIGHT_PX = 6, 320
_CAPTION_PX = 18
_CONFIDENCE_PX = 2 * _HEIGHT_PX


def write_sheet(path: Path, made: MadePerson, pictures: Sequence[HandPicture], caption: str) -> None:
    """Write the sheet: a row of pictures, one of ours in the light that was found, and the confidence in the atlas.

    Raises:
        LiveHandError: it cannot be written.
    """
    chosen = [pictures[index] for index in np.linspace(0, len(pictures) - 1, min(_COLUMNS, len(pictures))).astype(int)]
    columns = [np.concatenate(_pair(made, picture, made.lights), 0) for picture in chosen]
    confidence = _confidence(made)
    whole = np.concatenate([*columns, confidence], 1)
    image = Image.new("RGB", (whole.shape[1], whole.shape[0] + _CAPTION_PX), "white")
    image.paste(Image.fromarray(whole), (0, _CAPTION_PX))
    ImageDraw.Draw(image).text((4, 3), caption, fill="black")
    with replacing(path) as temporary:
        image.save(temporary, "PNG")


def _pair(made: MadePerson, picture: HandPicture, lights: PictureIlluminations) -> list[np.ndarray]:
    light = lights.at(picture)
    frame = made.model.rendered(picture.pose, picture.camera, light.tinted)
    straight = frame.rgb / np.maximum(frame.alpha[..., None], 1e-3)
    ours = encoded_colours(picture, straight)
    blended = ours * frame.alpha[..., None] + (picture.rgb / 255) * (1 - frame.alpha[..., None])
    return [_scaled(picture.rgb), _scaled((255 * blended).clip(0, 255).astype(np.uint8))]


def _scaled(rgb: np.ndarray) -> np.ndarray:
    height, width = rgb.shape[:2]
    size = max(1, round(width * _HEIGHT_PX / height)), _HEIGHT_PX
    return np.asarray(Image.fromarray(rgb).resize(size, Image.Resampling.LANCZOS))


def _confidence(made: MadePerson) -> np.ndarray:
    """Draw the atlas: the person's albedo where it was seen, grey where it is a guess."""
    texels = made.texels
    seen = made.completed.confidence[:, None]
    albedo = np.exp(made.completed.log_ratio + texels.at_texels(family_at_base(made.model)))
    colour = linear_to_srgb(albedo.clip(0, 1).astype(np.float32))
    image = np.full((texels.resolution**2, 3), 1.0, np.float32)
    image[texels.pixel] = seen * colour + (1 - seen) * 0.5
    upright = image.reshape(texels.resolution, texels.resolution, 3)[::-1]
    small = Image.fromarray((255 * upright).clip(0, 255).astype(np.uint8)).resize((_CONFIDENCE_PX, _CONFIDENCE_PX))
    return np.asarray(small)
