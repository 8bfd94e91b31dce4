"""A person's hand as Cycles shows it in one key lamp, with the figures it is judged by."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import torch

from ...backend.avatars.avatar import Avatar
from ...backend.capture.person import Person
from ...backend.capture.picture import linear_to_srgb, straight
from ...backend.evaluation.contact_sheet import label_strip, on_background, save_sheet, tile
from ...backend.evaluation.contrast_bands import BANDS_MM, SPAN, SPREAD_KEYS, band_key, colour_spread, contrast
from ...backend.evaluation.sheet_command import read_frame
from ...backend.evaluation.skin_colours import BACK, colour_findings, lab
from ...backend.hand.lbs import posed_vertices
from ...backend.hand.model import HandModel
from ...backend.hand.posed_bones import bone_frames
from ...backend.image.srgb import srgb_to_linear
from ...backend.records.light import Lamp, Light, Sky, rotation_facing
from ...backend.records.shot import Shot
from ...backend.render.renderer import Renderer
from ...livehand_blender.capture.node_graph import NodeGraph
from ...livehand_blender.capture.render import builtin_surface
from ...livehand_blender.capture.scene import capture_scene, set_camera
from ...livehand_blender.scene.file_paths import output_path
from .views import (
    CLOSE_UPS,
    LAMP_M,
    LAMP_SIDE_M,
    LAMP_W,
    WHOLE_HANDS,
    WORLD_STRENGTH,
    Aim,
    HandView,
    KeyLight,
    aim,
    towards_lamp,
)

_COLUMNS = 4
_WHOLE_PX = 480
# Places of `skin_colours` on the open hand: whether they are seen on the back, radius, mm, joints, and the offset of
# each from its joint along (distal, dorsal, radial), mm.
_POINTS_OF_COLOUR = {
    BACK: (True, 8.0, (4, 10), (-32.0, 0.0, 0.0)),
    "palm": (False, 8.0, (4, 10), (-32.0, 0.0, 0.0)),
    "fingertip pads": (False, 3.0, (3, 6, 12), (11.0, 0.0, 0.0)),
    "knuckles": (True, 4.0, (1, 4, 10), (0.0, 0.0, 0.0)),
    "middle joints": (True, 3.5, (2, 5, 11), (0.0, 0.0, 0.0)),
    "nails": (True, 3.0, (3, 6, 12), (12.0, 0.0, 0.0)),
    "forearm": (True, 8.0, (0,), (-90.0, 0.0, 0.0)),
}


def look_at(
    model: HandModel, person: Person, folder: Path, close_up_px: int, samples: int, threads: int | None
) -> dict[str, Any]:
    """Write `whole_hands.png` and `close_ups.png` into a folder, and measure.

    Returns:
        contrast: of each whole hand, see `contrast_bands`.
        lab: of the albedo by place, of those that are seen.
        unusual: see `colour_findings`, and places that are not seen.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="livehand-lookdev-") as work:
        studio = _Studio(model, person, Path(work), threads, samples)
        whole = {name: studio.picture(view, _WHOLE_PX) for name, view in WHOLE_HANDS.items()}
        close = {name: studio.picture(view, close_up_px) for name, view in CLOSE_UPS.items()}
        seen = studio.colours()
    points = {place: colour for place, colour in seen.items() if colour is not None}
    _save(whole, folder / "whole_hands.png", 3)
    _save(close, folder / "close_ups.png", _COLUMNS)
    return {
        "contrast": {name: _contrast(picture, WHOLE_HANDS[name].mm_per_px) for name, picture in whole.items()},
        "lab": {place: [round(float(value), 1) for value in colour] for place, colour in points.items()},
        "unusual": [*colour_findings(points), *(f"{place}: not seen" for place in seen if place not in points)],
    }


def look_at_avatar(avatar: Avatar, model: HandModel, folder: Path, close_up_px: int) -> dict[str, Any]:
    """Do the same with LiveHand's own frames of an avatar, in white light; its albedo is not measured."""
    folder.mkdir(parents=True, exist_ok=True)
    studio = AvatarStudio.of(avatar, model)
    whole = {name: studio.picture(view, _WHOLE_PX) for name, view in WHOLE_HANDS.items()}
    close = {name: studio.picture(view, close_up_px) for name, view in CLOSE_UPS.items()}
    _save(whole, folder / "whole_hands.png", 3)
    _save(close, folder / "close_ups.png", _COLUMNS)
    contrasts = {name: _contrast(picture, WHOLE_HANDS[name].mm_per_px) for name, picture in whole.items()}
    return {"contrast": contrasts, "lab": {}, "unusual": []}


def summary(figures: Mapping[str, Any]) -> str:
    """Word the figures of `look_at` for people."""
    return "\n".join(_lines(figures))


class _Studio:
    """The scene with one hand in it."""

    def __init__(self, model: HandModel, person: Person, folder: Path, threads: int | None, samples: int):
        """Build and bake it; `folder` is for its own files."""
        self._model, self._beta = model, np.array(person.beta)
        self._scene = capture_scene(threads)
        self._light = KeyLight(self._scene)
        self._picture = folder / "picture.png"
        self._surface = builtin_surface(model, person, folder / "skin")
        self._scene.cycles.samples = samples

    def picture(self, view: HandView, size_px: int) -> np.ndarray:
        """Return [size, size, 4] encoded colour times alpha, and alpha."""
        return self._render(aim(view, self._model, self._beta, size_px))

    def colours(self) -> dict[str, np.ndarray | None]:
        """Measure Lab [3] of the albedo at each place that this hand has; None: the picture does not show it."""
        _show_albedo(self._surface.object.active_material)
        self._scene.cycles.samples, self._scene.cycles.use_denoising = 4, False
        aims = {on_back: aim(WHOLE_HANDS[f"open, {side}"], self._model, self._beta, 1000) for on_back, side in _SIDES}
        albedo = {on_back: self._render(one) for on_back, one in aims.items()}
        found = {}
        for place, (on_back, radius_mm, joints, offset_mm) in _POINTS_OF_COLOUR.items():
            if place == "forearm" and not self._model.has_arm:
                continue
            at = aims[on_back]
            discs = [_disc(at, self._model, joint, offset_mm, radius_mm) for joint in joints]
            pixels = albedo[on_back][np.logical_or.reduce(discs)]
            opaque = torch.as_tensor(pixels[pixels[:, 3] > 0.99, :3])
            found[place] = lab(srgb_to_linear(opaque).double()).mean(0).numpy() if len(opaque) else None
        return found

    def _render(self, at: Aim) -> np.ndarray:
        self._surface.set_pose(at.pose)
        self._light.follow(at)
        set_camera(self._scene, at.camera)
        self._scene.render.filepath = output_path(self._picture)
        bpy.ops.render.render(write_still=True)
        return read_frame(self._picture)


@dataclass(frozen=True)
class AvatarStudio:
    """One avatar, as LiveHand renders it in the key lamp over a dim white world, in the shape of its person.

    Attributes:
        renderer: of the avatar.
        beta: [10] shape.
    """

    renderer: Renderer
    beta: np.ndarray

    @classmethod
    def of(cls, avatar: Avatar, model: HandModel) -> AvatarStudio:
        """Prepare the renderer."""
        beta = np.zeros(10) if avatar.surface is None else np.array(avatar.surface.person.beta)
        return cls(Renderer(avatar, model, "cpu"), beta)

    def picture(self, view: HandView, size_px: int) -> np.ndarray:
        """Return [size, size, 4] encoded colour times alpha, and alpha."""
        at = aim(view, self.renderer.hand, self.beta, size_px)
        vertices = posed_vertices(self.renderer.hand, at.pose)
        frame = self.renderer.render(Shot(at.pose, vertices, at.camera, _white_light(at), hair=1.0))
        alpha = frame.alpha[..., None]
        encoded = linear_to_srgb(straight(np.concatenate([frame.rgb, alpha], -1)).clip(0, 1)) * alpha
        return np.concatenate([encoded, alpha], -1).astype(np.float32)


def _white_light(at: Aim) -> Light:
    towards, size_m = towards_lamp(at), (LAMP_SIDE_M, LAMP_SIDE_M)
    position = at.subject_m + LAMP_M * towards
    key = Lamp("area", np.full(3, LAMP_W), position, rotation_facing(towards), size_m=size_m)
    return Light((key,), Sky(np.full((2, 4, 3), WORLD_STRENGTH)), shadow_quality="fine")


_SIDES = ((True, "back"), (False, "palm"))


def _show_albedo(material: bpy.types.Material) -> None:
    """Let the material emit its base colour and nothing else."""
    graph = NodeGraph(material.node_tree)
    colour = graph.tree.nodes["Principled BSDF"].inputs["Base Color"].links[0].from_socket
    emission = graph.node("ShaderNodeEmission")
    graph.connect(colour, emission.inputs["Color"])
    output = next(node for node in graph.tree.nodes if node.type == "OUTPUT_MATERIAL")
    graph.connect(emission.outputs[0], output.inputs["Surface"])


def _disc(at: Aim, model: HandModel, joint: int, offset_mm: tuple, radius_mm: float) -> np.ndarray:
    """Return the pixels around a place [H, W] of the posed hand."""
    frames = bone_frames(model, at.pose)
    place = frames[joint, :3, 3] + frames[joint, :3, :3] @ (np.array(offset_mm) * (-1, 1, 1)) / 1000
    ((x, y),), (depth_m,) = at.camera.project(place[None])
    width, height = at.camera.size_px
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    radius_px = radius_mm / 1000 * at.camera.K[0, 0] / depth_m
    return np.hypot(columns - x, rows - y) <= radius_px


def _contrast(picture: np.ndarray, mm_per_px: float) -> dict[str, float]:
    pixels = torch.as_tensor(picture)
    encoded, hand = pixels[..., :3], pixels[..., 3] > 0.5
    figures = contrast(encoded, hand, mm_per_px) | colour_spread(encoded, hand, mm_per_px)
    return {name: round(value, 2) for name, value in figures.items()}


def _save(pictures: Mapping[str, np.ndarray], path: Path, columns: int) -> None:
    tiles = [np.concatenate([label_strip(name, one.shape[1]), on_background(one)]) for name, one in pictures.items()]
    save_sheet(tile(tiles, columns), path)


def _lines(figures: Mapping[str, Any]) -> Iterator[str]:
    bands, waves = [band_key(band) for band in BANDS_MM], ", ".join(f"{low}-{high} mm" for low, high in BANDS_MM)
    yield f"deviation of L* by wavelength: {waves}; span; of a* and b*"
    for name, values in figures["contrast"].items():
        deviations, spread = (", ".join(f"{values[key]:.2f}" for key in keys) for keys in (bands, SPREAD_KEYS))
        yield f"  {name}: {deviations}; {values[SPAN]:.0f}; {spread}"
    if not figures["lab"]:
        return
    yield "albedo, Lab: " + "; ".join(f"{place} {' '.join(map(str, at))}" for place, at in figures["lab"].items())
    yield from figures["unusual"] or ["all colours are within the usual ranges"]
