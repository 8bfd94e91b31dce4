"""`livehand capture`: its arguments and its run."""

from __future__ import annotations

import argparse
import hashlib
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from ...backend.avatars.library import avatar_path
from ...backend.capture.capture import Split
from ...backend.capture.person import PERSONS, Person, find_person
from ...backend.capture.plan import CapturePlan
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import DEFAULT_HAND
from ...backend.records.errors import LiveHandError
from ...backend.surface.skin_version import SKIN_VERSION, skin_version
from ...backend.system.command import parse_size_px

if TYPE_CHECKING:
    from ...backend.avatars.worn_textures import WornTextures
    from .dressed_hand import DressedHand
    from .render import Subject

_SMALLEST_PX = 16  # of an image's sides: the granularity of the renderer's crop


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    plan = CapturePlan()
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="the capture's folder")
    parser.add_argument(
        "--hand",
        type=Path,
        help="your own hand model, from livehand make-hand, or hand_with_arm, the built-in one with a forearm "
        "(default: the built-in hand)",
    )
    parser.add_argument(
        "--look",
        type=Path,
        metavar="BLEND",
        help="the look of --hand (default: the .blend beside it, or else a plain skin)",
    )
    parser.add_argument("--seed", type=int, default=plan.seed, help="of poses and cameras (default: %(default)s)")
    parser.add_argument(
        "--poses", type=int, default=plan.poses, help="number, including held-out ones (default: %(default)s)"
    )
    parser.add_argument(
        "--cameras", type=int, default=plan.cameras, help="number, including held-out ones (default: %(default)s)"
    )
    parser.add_argument(
        "--cameras-per-pose",
        type=int,
        default=plan.cameras_per_pose,
        help="training cameras that see each pose (default: %(default)s)",
    )
    parser.add_argument(
        "--person",
        "--tone",
        default="light",
        metavar="NAME",
        help=f"whose skin and shape: {', '.join(PERSONS)}, a JSON file of numbers, or an avatar's "
        "file or name, whose very person is shown (default: %(default)s)",
    )
    parser.add_argument(
        "--size",
        type=partial(parse_size_px, smallest=_SMALLEST_PX),
        dest="size_px",
        default=plan.size_px,
        metavar="WxH",
        help="image size, px",
    )
    parser.add_argument("--samples", type=int, default=plan.samples, help="Cycles samples per pixel of training views")
    parser.add_argument(
        "--eval-samples", type=int, default=plan.eval_samples, help="Cycles samples per pixel of held-out views"
    )
    parser.add_argument(
        "--eval-views", type=int, default=plan.eval_views, help="largest number of views per held-out split"
    )
    parser.add_argument("--first-poses", type=int, default=plan.first_poses, help="render only the first N poses")
    parser.add_argument(
        "--lights",
        choices=("dome", "varied"),
        default=plan.lights,
        help="dome: the same light for all images (default); varied: a light for each, for avatars that can be lit",
    )
    parser.add_argument("--threads", type=int, default=None, help="render threads (default: all)")


def run(args: argparse.Namespace) -> dict:
    """Render the capture and return its counts."""
    from .render import render_capture

    hand = _hand(args)
    plan = _plan(args, hand)
    provenance = {"made_by": "livehand capture", "plan": plan.facts(), **_hand_facts(hand, plan.person)}
    capture = render_capture(args.output, plan, provenance, args.threads, hand)
    splits = [split for split in get_args(Split) if capture.is_lit or split != "novel_light"]
    counts = {split: len(capture.of_split(split)) for split in splits}
    return {"folder": str(args.output), "poses": len(capture.poses), "images": len(capture.views), **counts}


def _hand_facts(hand: Subject | None, person: Person) -> dict[str, str | None]:
    """Describe whose hand it is and which built-in skin, as provenance: captures of different skins are not mixed."""
    from .dressed_hand import DressedHand
    from .skin import SkinTone

    if isinstance(hand, DressedHand):
        return {"hand": hand.model.name, SKIN_VERSION: skin_version(), "worn_skin": _digest(hand.textures)}
    tone = {"skin_tone": hashlib.sha256(repr(SkinTone.of(person)).encode()).hexdigest()[:12]}
    if hand is None or isinstance(hand, HandModel):
        name = {"hand": hand.name} if hand else {}
        return {**name, SKIN_VERSION: skin_version(), **tone}
    if hand.materials is None:
        return {"hand": hand.model.name, "look_sha256": None, **tone}
    return {"hand": hand.model.name, "look_sha256": hashlib.sha256(hand.materials.read_bytes()).hexdigest()}


def _digest(textures: WornTextures) -> str:
    """Return the identity of what a person's networks and surface show together."""
    return hashlib.sha256((textures.reflectance * 255).round().astype("uint8").tobytes()).hexdigest()[:12]


def _plan(args: argparse.Namespace, hand: Subject | None) -> CapturePlan:
    from .dressed_hand import DressedHand

    settings: dict[str, Any] = {field.name: getattr(args, field.name) for field in fields(CapturePlan)}
    settings["person"] = hand.textures.person if isinstance(hand, DressedHand) else find_person(args.person)
    return CapturePlan(**settings)


def _hand(args: argparse.Namespace) -> Subject | None:
    """Load the hand of --hand and --look, or a built-in one, in the skin of --person's avatar; None: the default."""
    from ...backend.hand.model_file import is_builtin_hand, load_hand_model
    from .hand_materials import materials_path
    from .render import HandWithMaterials

    avatar = avatar_path(args.person)
    is_avatar = avatar.suffix.lower() == ".safetensors" and args.person not in PERSONS
    if args.hand is None or is_builtin_hand(args.hand):
        if args.look is not None:
            raise LiveHandError("--look belongs to a hand of your own; pass that hand with --hand")
        if is_avatar:
            return _in_skin_of(avatar, load_hand_model(args.hand or DEFAULT_HAND))
        return load_hand_model(args.hand) if args.hand else None
    if is_avatar:
        raise LiveHandError(f"an avatar's person has the built-in hand, got --hand {args.hand}; leave one of both out")
    materials = args.look or materials_path(args.hand)
    if args.look and not materials.is_file():
        raise LiveHandError(f"no look at {materials}; pass the .blend that livehand make-hand wrote")
    return HandWithMaterials(load_hand_model(args.hand), materials if materials.is_file() else None)


def _in_skin_of(path: Path, model: HandModel) -> DressedHand:
    from ...backend.avatars.file import load_avatar
    from ...backend.avatars.worn_textures import worn_textures
    from .dressed_hand import DressedHand

    return DressedHand(model, worn_textures(load_avatar(path), model))
