"""`livehand consistency` beside pictures by Cycles, where Blender is installed."""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...backend.research.consistency import command

if TYPE_CHECKING:
    import numpy as np

    from ...backend.research.benchmark.motion import MotionFrame
    from ...backend.research.consistency.measure import Truth

_NEEDED = ("bpy", "scipy", "skimage")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Measure, with Cycles if it is installed."""
    return command.run(args, None if any(find_spec(name) is None for name in _NEEDED) else cycles_truth)


def cycles_truth(samples: int) -> Truth:
    """Build the hand that captures show, in their light; returns what renders it."""
    import numpy as np

    from .cycles import CyclesHand

    hand = CyclesHand.create(None, None)

    def render(frame: MotionFrame) -> np.ndarray:
        from PIL import Image

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "truth.png"
            hand.save(frame, samples, path)
            pixels = np.asarray(Image.open(path), np.float32) / 255
        return np.concatenate([pixels[..., :3] * pixels[..., 3:], pixels[..., 3:]], -1)

    return render


COMMAND = replace(command.COMMAND, run=run)
