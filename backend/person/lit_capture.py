"""A capture in the light that a person's avatar finds in it, to train on with light and skin held fixed.

Where the person is known, what pictures show tells the light and the poses. The capture that is written shows the
built-in hand: with these lights, the person's surface, and pictures in one exposure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from ..avatars.avatar import Avatar
from ..capture.capture import Capture, CaptureView, SurfaceReference, save_capture_index
from ..capture.lights import CaptureLight
from ..capture.picture import linear_to_srgb
from ..hand.model import HandModel
from ..records.errors import LiveHandError
from ..records.frame import Frame
from ..records.hand_picture import HAND, UNKNOWN, HandPicture
from ..surface.surface_file import surface_sha256, write_surface
from ..system.files import replacing
from .captured_pictures import pictures_of_capture, with_gains
from .fit.refit import refitted
from .lit_model.illumination import Illumination, fitted_light, linear_colours, pixels_of_scenes
from .lit_model.lamp_search import with_lamp
from .lit_model.model import PersonModel
from .lit_model.numbers import PixelTones
from .lit_model.picture_lights import PictureIlluminations

_MOST_PICTURES, _REFITS = 120, 2
_LEAST_ALPHA = 1e-3
_SURFACE = "surface/person.npz"


def write_lit_capture(
    folder: Path,
    person: Avatar,
    model: HandModel,
    other: HandModel | None,
    output: Path,
    log: Callable[[str], None] = lambda line: None,
) -> Capture:
    """Find light and poses of a capture by its person, and write the capture with them.

    Args:
        folder: of the capture.
        person: made from it.
        model: the built-in hand.
        other: the capture's own hand model; None: the built-in one.
        output: folder to write.
        log: is told what begins.

    Raises:
        LiveHandError: the capture cannot be read, the avatar holds no person, or pictures do not show the hand.
    """
    if person.surface is None or person.hand_sha256 != model.sha256:
        raise LiveHandError(f"'{person.name}' must be a person of '{model.name}'; make one with livehand person")
    hand = pictures_of_capture(folder, model, _MOST_PICTURES, other, log)
    beta = np.array(person.surface.person.beta)
    pictures = with_gains([replace(one, pose=replace(one.pose, beta=beta)) for one in hand.pictures], model)
    known = PersonModel.of(person, model)
    for _ in range(_REFITS):
        lights = PictureIlluminations(scene_lights(known, pictures, finds_lamps=False))
        refit = refitted(known, pictures, lights, fits_shape=False)
        log(f"poses: flow was {refit.flow_px:.1f} px, masks overlapped by {refit.overlap:.3f}")
        pictures = with_gains(refit.pictures, model)
    lights = scene_lights(known, pictures)
    write_surface(output / _SURFACE, person.surface)
    surface = SurfaceReference(_SURFACE, surface_sha256(person.surface))
    facts = {"made_by": "livehand train --person", "source": hand.source, "is_mirrored": hand.side == "left"}
    return _written(known, pictures, lights, Capture(output, model.sha256, facts, (), (), surface=surface))


def scene_lights(
    person: PersonModel, pictures: Sequence[HandPicture], finds_lamps: bool = True
) -> dict[int, Illumination]:
    """Fit the light of every scene, and its colour: the person's albedo is known.

    Args:
        person: with their skin.
        pictures: of all scenes.
        finds_lamps: look for a lamp beside the sky in each; the fit of poses can do without.

    Raises:
        LiveHandError: pictures of a scene show hardly any skin.
    """
    lights = {}
    for scene, pixels in pixels_of_scenes(person, pictures).items():
        known = PixelTones(pixels, np.zeros_like(pixels.shown), np.zeros_like(pixels.shown))
        lit = with_lamp(person, known, 0.0).pixels if finds_lamps else pixels
        lights[scene] = Illumination.of(fitted_light(lit, np.ones_like(lit.shown)), lit.sources)
    return lights


def _written(
    known: PersonModel, pictures: Sequence[HandPicture], lights: Mapping[int, Illumination], capture: Capture
) -> Capture:
    scenes, moments = list(lights), list(dict.fromkeys(picture.moment for picture in pictures))
    views = []
    for index, picture in enumerate(pictures):
        exposure = min(1.0, float(np.exp(np.min(picture.log_gain))))
        view = CaptureView(
            f"images/{index:04d}.png",
            picture.camera,
            picture.camera_index,
            moments.index(picture.moment),
            "novel_pose" if picture.is_held_out else "train",
            light=scenes.index(picture.scene),
            exposure=exposure,
        )
        own = known.rendered(picture.pose, picture.camera, lights[picture.scene].tinted)
        _write_picture(capture.folder / view.file, picture, own, exposure)
        views.append(view)
    poses = {moments.index(picture.moment): picture.pose for picture in pictures}
    of_scene = tuple(CaptureLight("found", light.tinted) for light in lights.values())
    whole = replace(
        capture, poses=tuple(poses[row] for row in range(len(moments))), views=tuple(views), lights=of_scene
    )
    save_capture_index(whole)
    return whole


def with_own_unknown(picture: HandPicture, own: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Return a picture's linear colors [H, W, 3] and alpha [H, W]: where it is unknown, what its person shows there.

    So training leaves as it is what no picture tells, such as an arm that masks end before.

    Args:
        picture: with its labels.
        own: frame of its person, in its light.
    """
    is_unknown, is_hand = picture.labels == UNKNOWN, picture.labels == HAND
    straight = own.rgb / np.maximum(own.alpha[..., None], _LEAST_ALPHA)
    linear = np.where(is_unknown[..., None], straight, linear_colours(picture))
    return linear, np.where(is_unknown, own.alpha, is_hand.astype(own.alpha.dtype))


def _write_picture(path: Path, picture: HandPicture, own: Frame, exposure: float) -> None:
    """Write a picture in the exposure and white balance that all share."""
    linear, alpha = with_own_unknown(picture, own)
    encoded = linear_to_srgb((linear * exposure).clip(0, 1).astype(np.float32))
    pixels = (255 * np.concatenate([encoded, alpha[..., None]], -1)).round().clip(0, 255).astype(np.uint8)
    with replacing(path) as temporary:
        Image.fromarray(pixels).save(temporary)
