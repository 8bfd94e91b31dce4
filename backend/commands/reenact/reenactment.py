"""Re-enacts a tracked video: frame after frame the avatars over the footage, as its look asks for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageFilter

from ...avatars.metadata import watermark_of
from ...image.watermark.embedding import watermarked
from ...records.frame import Frame
from ...records.light import Light
from ...records.shot import Shot
from ...render.renderer import Renderer
from ...tracking.video import VideoFrame
from .film_look import Look
from .film_texture import FilmTexture
from .filmed_shots import FilmedShots
from .open_shutter import exposed
from .overlay import over, smooth_gains

_MARGIN, _MARGIN_OF_PX = (
    0.06,
    320,
)  # of the width, by which the plate reaches beyond the avatar; of films at most so wide


def reenacted(
    frames: Iterable[VideoFrame],
    hands: Sequence[FilmedShots],
    renderers: Sequence[Renderer],
    look: Look,
    is_side_by_side: bool,
    shutter_frames: float,
) -> Iterator[np.ndarray]:
    """Put each avatar over the footage, side by side, uint8 [H, W * n, 3]; the original first where it is wanted.

    The shutter is open for so many frames around each; what moves meanwhile is blurred.
    """
    for number, (time_s, picture) in enumerate(frames):
        shown = [picture] if is_side_by_side else []
        present = [(shots, at) for shots in hands if (at := shots.index_at(time_s)) is not None]
        for index, renderer in enumerate(renderers):
            gain = smooth_gains(look.times, look.gains[index], np.array([time_s]))[0]
            avatar = _Avatar(renderer, look.lights[index], gain, look.textures[index])
            shown.append(_composed(picture, present, avatar, look.plate, shutter_frames, number))
        yield np.concatenate(shown, 1)


class _Avatar(NamedTuple):
    """An avatar, and how the film shows it at a time: its light, the gain [3] of it, and its texture."""

    renderer: Renderer
    light: Light
    gain: np.ndarray
    texture: FilmTexture

    def render(self, shot: Shot) -> Frame:
        return self.renderer.render(replace(shot, light=self.light))

    def marked(self, frame: Frame) -> Frame:
        """Write the watermark that the avatar asks for, if it does, into a frame as the film shows it."""
        payload = watermark_of(self.renderer.avatar.provenance)
        return frame if payload is None else replace(frame, rgb=watermarked(frame.rgb, frame.alpha, payload))


def _composed(
    picture: np.ndarray,
    present: Sequence[tuple[FilmedShots, int]],
    avatar: _Avatar,
    plate: np.ndarray | None,
    shutter_frames: float,
    seed: int,
) -> np.ndarray:
    if not present:
        return picture
    shots = [(one, at, one.shot(at)) for one, at in present]
    composed = picture
    for one, at, shot in sorted(shots, key=lambda each: -_depth(each[2])):  # the farther hand first
        frame, alpha = exposed(one, at, avatar.render, shutter_frames)
        ground = composed if plate is None else _over_plate(composed, plate, alpha, one.before_the_cut(shot))
        soft = avatar.marked(avatar.texture.softened(frame))
        composed = avatar.texture.grained(over(soft, ground, avatar.gain), soft.alpha, seed)
    return composed


def _depth(shot: Shot) -> float:
    return float(np.median(shot.vertices @ shot.camera.cam2world[:3, 2]))


def _over_plate(picture: np.ndarray, plate: np.ndarray, alpha: np.ndarray, front: np.ndarray) -> np.ndarray:
    """Lay the plate around the avatar, where the real hand stands out, softly; the arm stays."""
    height, width = alpha.shape
    radius = max(1, round(_MARGIN * width * _MARGIN_OF_PX / (4 * max(width, _MARGIN_OF_PX))))
    small = Image.fromarray((alpha > 0.5).astype(np.uint8) * 255).resize((max(1, width // 4), max(1, height // 4)))
    soft = small.filter(ImageFilter.MaxFilter(2 * radius + 1)).filter(ImageFilter.GaussianBlur(radius / 2))
    share = (np.asarray(soft.resize((width, height)), np.float32) / 255 * front)[..., None]
    return (plate * share + picture * (1 - share)).round().astype(np.uint8)
