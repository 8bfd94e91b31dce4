"""The cuts: hands alone by the interface for programs, examples in their scenes and a re-enacted film by commands."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image

from ... import api
from ...backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ...backend.hand.gestures import FingerAxes, theta_of
from ...backend.hand.model_file import load_default_hand
from ...backend.hand.poses import POSES
from ...backend.person.invented.command import new_person
from ...backend.surface.people.look import PersonLook
from ..assets_lock import ROOT
from .cut import Cut, Draw, FilmSet, eased, side_by_side

WAVE = ("Relaxed", "Open", "Spread", "Victory", "OK", "Thumbs Up", "Loose Fist", "Fist", "Point", "Relaxed")
PEOPLE = ("light", "middle", "deep")
_EXAMPLES = ROOT / "examples"
_HELD = 0.35  # of the time from pose to pose
_LAMP_W, _LAMP_M, _LAMP_SIDE_M, _NIGHT = 6.0, 0.6, 0.15, 0.025


def poses(film_set: FilmSet) -> Draw:
    """Go through poses of the library, in a studio's light."""
    person = api.load_person("light")
    camera = person.camera(api.named_pose("Spread"), film_set.size_px)
    return lambda share: film_set.over_backdrop(person.render(_between(WAVE, share), camera, api.studio_light()))


def people(film_set: FilmSet) -> Draw:
    """Turn the hand of each person who ships, one after the other."""
    persons = [api.load_person(name) for name in PEOPLE]
    return lambda share: _turned(film_set, persons[int(share * len(persons))], share * len(persons) % 1)


def circling_lamp(film_set: FilmSet) -> Draw:
    """Let one lamp circle a hand in the dark."""
    person, pose = api.load_person("middle"), api.named_pose("Claw", wrist=np.array([0, 0, 0.35]))
    camera = person.camera(pose, film_set.size_px)
    middle = person.vertices(pose)[person.hand.framed_vertices].mean(0)
    return lambda share: film_set.over_backdrop(person.render(pose, camera, _lamp_at(middle, 2 * np.pi * share)))


def old_and_new_light(film_set: FilmSet) -> Draw:
    """Show a hand as its capture was lit, beside the same hand in light that changes."""
    person = api.load_person("deep")
    camera = person.camera(api.named_pose("Open"), film_set.size_px)

    def draw(share: float) -> np.ndarray:
        pose = api.named_pose("Open", wrist=np.array([0, 0, 0.6 * np.sin(2 * np.pi * share)]))
        return side_by_side(
            *(film_set.over_backdrop(person.render(pose, camera, light)) for light in (None, _sunset(share)))
        )

    return draw


def person_by_numbers(film_set: FilmSet, numbers: dict[str, float | None], seed: int) -> Draw:
    """Make a person from numbers, without training, and turn their hand."""
    look = PersonLook.of(seed, numbers)
    avatar = new_person(look, "by numbers", lambda line: None)
    return partial(_turned, film_set, api.Person(avatar, load_default_hand()))


def _turned(film_set: FilmSet, person: api.Person, share: float) -> np.ndarray:
    pose = api.named_pose("Relaxed", wrist=np.array([0, 0, 2 * np.pi * eased(share)]))
    camera = person.camera(api.named_pose("Relaxed"), film_set.size_px)
    return film_set.over_backdrop(person.render(pose, camera, api.studio_light()))


def _between(names: Sequence[str], share: float) -> api.HandPose:
    """Rest at each pose of a row, and go on to the next."""
    legs = list(pairwise(names))
    at = min(share * len(legs), len(legs) - 1e-9)
    start, end = (POSES[name].gesture.angles_deg() for name in legs[int(at)])
    gone = eased(float(np.clip((at % 1 - _HELD) / (1 - _HELD), 0, 1)))
    turn = axis_angle_to_matrix(np.array([0, 0, 0.3 * np.sin(2 * np.pi * share)]))
    upright = api.named_pose(names[0])
    theta = theta_of((1 - gone) * start + gone * end, FingerAxes.of_default_hand())
    theta[0] = matrix_to_axis_angle(turn @ axis_angle_to_matrix(upright.theta[0]))
    return replace(upright, theta=theta)


def _lamp_at(middle: np.ndarray, azimuth_rad: float) -> api.Light:
    towards = np.array([np.sin(azimuth_rad), -np.cos(azimuth_rad), 0.4])
    towards /= np.linalg.norm(towards)
    side_m = (_LAMP_SIDE_M, _LAMP_SIDE_M)
    lamp = api.Lamp(
        "area", np.full(3, _LAMP_W), middle + _LAMP_M * towards, api.rotation_facing(towards), size_m=side_m
    )
    return api.Light((lamp,), api.Sky(np.full((2, 4, 3), _NIGHT)), shadow_quality="fine")


def _sunset(share: float) -> api.Light:
    """Go from noon to the evening: a sun that sinks and reddens, under a sky that turns blue."""
    height, warm = 1.1 * (1 - share) + 0.12, np.array([1.0, 1 - 0.5 * share, 1 - 0.8 * share])
    towards = np.array([-0.8, -0.5, height])
    towards /= np.linalg.norm(towards)
    sun = api.Lamp("sun", 3.2 * warm, rotation=api.rotation_facing(towards), angle_rad=0.02)
    sky = (1 - share) * np.array([0.28, 0.31, 0.36]) + share * np.array([0.05, 0.07, 0.14])
    return api.Light((sun,), api.Sky(np.broadcast_to(sky, (2, 4, 3)).copy()), shadow_quality="fine")


def scene_frames(film_set: FilmSet, shot: str, turns_back: bool) -> Draw:
    """Render an example by F12's road, and show its frames; at the end backwards."""
    paths = _rendered(film_set, shot)
    order = paths + paths[::-1] if turns_back else paths
    return lambda share: film_set.fitted(_opened(order, share))


def still(film_set: FilmSet, shot: str) -> Draw:
    """Render one F12 of an example, and go nearer."""
    picture = Image.open(_rendered(film_set, shot)[0])
    return lambda share: film_set.fitted(picture, 1 + 0.35 * eased(share))


def re_enacted(film_set: FilmSet) -> Draw:
    """Film one of our own hands, track it, and let another person re-enact it, beside the film."""
    footage, shown = film_set.folder / "footage.mp4", film_set.folder / "re_enacted_frames"
    if not footage.exists():
        _run(sys.executable, _EXAMPLES / "phone_video.py", "film", footage, film_set.folder / "footage.npz")
    if not shown.exists():
        unfinished = shown.with_suffix(".part")
        shutil.rmtree(unfinished, ignore_errors=True)
        _livehand("reenact", footage, "-o", unfinished, "--avatar", "deep", "--side-by-side")
        unfinished.rename(shown)
    paths = sorted(shown.glob("*.png"))
    return lambda share: _letterboxed(film_set, _opened(paths, share))


def _rendered(film_set: FilmSet, shot: str) -> list[Path]:
    """Render the frames of an example that are not there yet; returns all in order."""
    folder = film_set.folder / f"{shot}_frames"
    _livehand("render", _EXAMPLES / f"{shot}.blend", "-o", folder, "--format", "png")
    return sorted(folder.glob("*.png"))


def _opened(paths: Sequence[Path], share: float) -> Image.Image:
    """Open the picture at a share of a row's time, below 1."""
    return Image.open(paths[int(share * len(paths))])


def _letterboxed(film_set: FilmSet, picture: Image.Image) -> np.ndarray:
    """Show the whole of a picture, on black."""
    width, height = film_set.size_px
    scale = min(width / picture.width, height / picture.height)
    small = picture.convert("RGB").resize((round(picture.width * scale), round(picture.height * scale)))
    canvas = Image.new("RGB", film_set.size_px)
    canvas.paste(small, ((width - small.width) // 2, (height - small.height) // 2))
    return np.asarray(canvas)


def _livehand(*words: object) -> None:
    _run(sys.executable, "-m", "livehand.livehand_blender", *words)


def _run(*words: object) -> None:
    subprocess.run([str(word) for word in words], check=True)


AGED: dict[str, float | None] = {"age": 68.0, "tone": 0.25, "veins": 0.7, "freckles": 0.6}
YOUNG: dict[str, float | None] = {"age": 24.0, "tone": 0.75}
CUTS = (
    Cut("poses", "Pose a hand in Blender, get photoreal frames back", 20, poses),
    Cut("people", "Three people ship with it; none of them exists", 15, people),
    Cut("lamp", "In the light of your scene: one lamp, circling", 12, circling_lamp),
    Cut("light", "Left: the light of the capture. Right: any other", 14, old_and_new_light),
    Cut(
        "aged",
        "A person made by numbers, without training: 68 years",
        10,
        partial(person_by_numbers, numbers=AGED, seed=7),
    ),
    Cut("young", "And another: 24 years, another seed", 10, partial(person_by_numbers, numbers=YOUNG, seed=19)),
    Cut(
        "grasp",
        "A hand that grasps: shadows fall both ways",
        8,
        partial(scene_frames, shot="grasp", turns_back=True),
    ),
    Cut("egg", "One F12: hand and arm are LiveHand's, the rest is Cycles'", 8, partial(still, shot="egg")),
    Cut("re_enacted", "A film, tracked, and re-enacted by another person", 20, re_enacted),
)
