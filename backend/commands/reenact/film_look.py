"""What is measured of a film before it is re-enacted: its ground, its light, its colours, and how sharp it is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from PIL import Image, ImageFilter

from ...image.srgb import srgb_to_linear
from ...records.frame import Frame
from ...records.light import Light
from ...render.renderer import Renderer
from ...render.studio_light import studio_light
from ...tracking.video import VideoFrame
from .film_light import light_of, shaded_hand, sky_parts
from .film_texture import FilmTexture, blur_of, grain_of
from .filmed_shots import FilmedShots
from .open_shutter import hand_alone, path_px
from .overlay import colour_gain, over
from .plate import clean_plate

_SAMPLES = 24  # frames that are measured
_SAMPLE_WIDTH_PX = 320
_MARGIN = 0.06  # of a sample's width, by which the real hand may stand out
_OTHER = 24  # of 255, by which a pixel differs from the plate where the real hand is
_CALM_PX = 2.0  # path in a frame, below which a hand is sharp
_SHARP_SAMPLES = 6


@dataclass(frozen=True)
class Look:
    """What was measured of the footage.

    Attributes:
        plate: uint8 [H, W, 3] without the hand; None if the camera moves.
        times: [N] s of the samples with a hand.
        gains: for each avatar [N, 3], of its light.
        lights: that each avatar is rendered in.
        textures: sharpness and grain for each avatar.
    """

    plate: np.ndarray | None
    times: np.ndarray
    gains: tuple[np.ndarray, ...]
    lights: tuple[Light, ...]
    textures: tuple[FilmTexture, ...]


class _Sample(NamedTuple):
    """A frame, the one before it, where hands may be [H, W], and the hands with their motions' frames."""

    time_s: float
    picture: np.ndarray
    before: np.ndarray
    covered: np.ndarray
    hands: tuple[tuple[FilmedShots, int], ...]


def measured_look(
    frames: Iterable[VideoFrame], count: int, hands: Sequence[FilmedShots], renderers: Sequence[Renderer]
) -> Look:
    """Measure the footage in some of its frames, evenly spread."""
    samples = _samples(frames, max(1, count // _SAMPLES), hands, renderers[0])
    covered = [sample.covered for sample in samples]
    plate = clean_plate([sample.picture for sample in samples], covered)
    pairs = [(sample.before, sample.picture) for sample in samples]
    grain = (np.zeros(3), 0.0) if plate is None else grain_of(pairs, covered)
    lights, gains, textures = [], [], []
    times: np.ndarray = np.zeros(1)
    for renderer in renderers:
        light = _light(samples, renderer, plate)
        times, table = _gains(samples, renderer, light, plate)
        lights.append(light)
        gains.append(table)
        textures.append(FilmTexture(_blur(samples, renderer, light, np.median(table, 0), plate), *grain))
    return Look(plate, times, tuple(gains), tuple(lights), tuple(textures))


def _samples(
    frames: Iterable[VideoFrame], step: int, hands: Sequence[FilmedShots], renderer: Renderer
) -> list[_Sample]:
    found, before = [], None
    for index, (time_s, picture) in enumerate(frames):
        if index % step == min(1, step - 1):
            seen = tuple((shots, at) for shots in hands if (at := shots.index_at(time_s)) is not None)
            mask = np.zeros(picture.shape[:2], bool)
            for shots, at in seen:
                shot = shots.shot(at, _scale(picture))
                alpha = hand_alone(renderer.render(shot), shot, shots).alpha
                mask |= _grown(alpha > 0, (picture.shape[1], picture.shape[0]))
            found.append(_Sample(time_s, picture, picture if before is None else before, mask, seen))
        before = picture
    return found


def _light(samples: Sequence[_Sample], renderer: Renderer, plate: np.ndarray | None) -> Light:
    """Find the light that shades the avatar as the real hand is; of avatars with baked light, the studio's."""
    if not renderer.is_relightable:
        return studio_light()
    parts, shaded = sky_parts(), []
    for sample in samples[::2]:
        for shots, at in sample.hands:
            shot = shots.shot(at, _scale(sample.picture))
            rendered = [renderer.render(replace(shot, light=part)) for part in parts]
            alone = [hand_alone(frame, shot, shots) for frame in rendered]
            shown = _where_shown(sample.picture, plate, alone[0])
            shaded.append(shaded_hand(alone, _linear(_small(sample.picture, alone[0])), shown))
    return light_of([one for one in shaded if one is not None]) or studio_light()


def _gains(
    samples: Sequence[_Sample], renderer: Renderer, light: Light, plate: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Measure the gains [N, 3] of an avatar's light at times [N]; ones, where no hand shows enough."""
    times, gains = [], []
    for sample in samples:
        for shots, at in sample.hands:
            shot = replace(shots.shot(at, _scale(sample.picture)), light=light)
            frame = hand_alone(renderer.render(shot), shot, shots)
            shown = _where_shown(sample.picture, plate, frame)
            gain = colour_gain(frame, _small(sample.picture, frame), shown)
            if gain is not None:
                times.append(sample.time_s)
                gains.append(gain)
    return np.array(times or [0.0]), np.array(gains) if gains else np.ones((1, 3))


def _blur(
    samples: Sequence[_Sample], renderer: Renderer, light: Light, gain: np.ndarray, plate: np.ndarray | None
) -> float:
    """Measure by how many px an avatar must be blurred where its hand hardly moves; 0: it is sharper nowhere."""
    found: list[float] = []
    calm = [
        (sample, *hand) for sample in samples for hand in sample.hands if path_px(*hand, shutter_frames=1.0) < _CALM_PX
    ]
    for sample, shots, at in calm[:: max(1, len(calm) // _SHARP_SAMPLES)]:
        shot = replace(shots.shot(at), light=light)
        frame = hand_alone(renderer.render(shot), shot, shots)
        is_hand = (frame.alpha > 0.5) & _where_shown(sample.picture, plate, frame)

        def shown(blur_px: float, frame: Frame = frame, ground: np.ndarray = sample.picture) -> np.ndarray:
            return over(FilmTexture(blur_px).softened(frame), ground, gain)

        blur_px = blur_of(shown, sample.picture, is_hand)
        if blur_px is not None:
            found.append(blur_px)
    return float(np.median(found)) if found else 0.0


def _where_shown(picture: np.ndarray, plate: np.ndarray | None, frame: Frame) -> np.ndarray:
    """Tell where [h, w] of a frame the picture shows what the plate does not; everywhere, without one."""
    if plate is None:
        return np.ones(frame.alpha.shape, bool)
    change = np.abs(_small(picture, frame).astype(np.int16) - _small(plate, frame)).max(-1)
    return change > _OTHER


def _small(picture: np.ndarray, frame: Frame) -> np.ndarray:
    """Resize a picture to a frame's size."""
    height, width = frame.alpha.shape
    if picture.shape[:2] == (height, width):
        return picture
    return np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.BOX))


def _linear(picture: np.ndarray) -> np.ndarray:
    return srgb_to_linear(torch.from_numpy(picture.astype(np.float32) / 255)).numpy()


def _scale(picture: np.ndarray) -> float:
    return min(1.0, _SAMPLE_WIDTH_PX / picture.shape[1])


def _grown(mask: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """Grow the mask by the margin: [H, W] bool, at the picture's size."""
    radius = max(1, round(_MARGIN * mask.shape[1]))
    grown = Image.fromarray(mask.astype(np.uint8) * 255).filter(ImageFilter.MaxFilter(2 * radius + 1))
    return np.asarray(grown.resize(size_px, Image.Resampling.NEAREST)) > 0
