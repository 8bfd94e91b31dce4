"""`livehand consistency`: does the same skin look the same in neighbouring frames."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...avatars.library import AVATAR_HELP, avatar_path
from ...system.command import Command, parse_count, parse_size_px
from ...system.files import replacing

if TYPE_CHECKING:
    from .measure import Truth

_MOTIONS = ("turntable", "wave")
_FEWEST = 3


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("avatar", type=avatar_path, help=AVATAR_HELP)
    add("-o", "--output", type=Path, metavar="FILE.json", help="also write the figures there")
    add("--hand", type=Path, metavar="FILE", help="hand model of the avatar (default: built-in)")
    add("--motions", nargs="+", choices=_MOTIONS, default=list(_MOTIONS), help="default: both")
    add("--frames", type=_parse_frames, default=12, metavar="N", help="of each motion, from 3 (default: %(default)s)")
    add("--per-turn", type=parse_count, default=96, metavar="N", help="frames of a whole turn (default: %(default)s)")
    add("--size", type=parse_size_px, default=(167, 256), metavar="WxH", help="px (default: 167x256)")
    add("--truth-samples", type=parse_count, metavar="N", help="also render the frames by Cycles, N samples a pixel")


def _parse_frames(text: str) -> int:
    return parse_count(text, smallest=_FEWEST)


def run(args: argparse.Namespace, make_truth: Callable[[int], Truth] | None = None) -> dict[str, Any]:
    """Measure the motions and return the figures; `make_truth` takes the samples a pixel (None: there is no Cycles)."""
    from ...avatars.file import load_avatar
    from ...hand.model_file import DEFAULT_HAND, load_hand_model
    from ...records.errors import LiveHandError
    from ...render.renderer import Renderer
    from .measure import measure, motion_frames

    if args.truth_samples and make_truth is None:
        raise LiveHandError('the truth needs Cycles; install it with: pip install "livehand[capture]"')
    renderer = Renderer(load_avatar(args.avatar), load_hand_model(args.hand or DEFAULT_HAND), "cpu")
    truth = make_truth(args.truth_samples) if make_truth and args.truth_samples else None
    found = {}
    for name in args.motions:
        frames = motion_frames(name, renderer.hand, args.size, args.frames, args.per_turn)
        measured = measure(renderer, frames, truth)
        found[name] = {**asdict(measured), "beyond": measured.beyond}
    if args.output:
        with replacing(args.output) as temporary:
            temporary.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    lines = [_line(name, figures) for name, figures in found.items()]
    return {**found, "summary": "\n".join(lines)}


def _line(name: str, figures: dict[str, Any]) -> str:
    text = f"{name}: differs by {figures['difference']:.2f} of 255 along the skin, flickers by {figures['flicker']:.2f}"
    if figures["beyond"] is None:
        return text
    return f"{text}; the truth by {figures['truth_difference']:.2f} and {figures['truth_flicker']:.2f}"


COMMAND = Command("consistency", "measure whether neighbouring frames show the same skin alike", _add_arguments, run)
