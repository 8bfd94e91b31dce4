"""`livehand fetch-tracker`: the one command that brings the hand tracker's networks."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..system.command import Command
from .weights import fetch_networks, load_networks, take_networks


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--weights",
        type=Path,
        metavar="FILE",
        help="take them from this wheel of mediapipe 0.10.21 or hand_landmarker.task; nothing is downloaded",
    )


def _run(args: argparse.Namespace) -> dict[str, Any]:
    folder = take_networks(args.weights) if args.weights else fetch_networks()
    load_networks(folder)
    return {"folder": str(folder), "summary": f"{folder}: the hand tracker's networks, with their licence"}


COMMAND = Command("fetch-tracker", "fetch the networks of the hand tracker, once", _add_arguments, _run)
