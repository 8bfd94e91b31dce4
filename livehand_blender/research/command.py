"""`livehand benchmark` with Cycles, where Blender is installed."""

from __future__ import annotations

import argparse
from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from ...backend.research.benchmark import command as benchmark
from ...backend.system.command import say

if TYPE_CHECKING:
    from ...backend.research.benchmark.measure import CyclesRender

# Building the detailed surface needs these; pip's extra `capture` installs them.
_NEEDED = ("bpy", "scipy", "skimage")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run the benchmark, with Cycles if it is installed and wanted."""
    missing = [name for name in _NEEDED if find_spec(name) is None]
    if missing and not args.no_cycles:
        say(f"without Cycles: {', '.join(missing)} not installed (pip install 'livehand[capture]')")
    return benchmark.run(args, None if missing or args.no_cycles else _make_cycles)


def _make_cycles(args: argparse.Namespace) -> CyclesRender:
    say("building the hand that Cycles renders")
    from .cycles import CyclesHand

    return CyclesHand.create(args.cycles_skin, args.threads).render


COMMAND = replace(benchmark.COMMAND, run=run)
