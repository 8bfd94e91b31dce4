"""The commands that need no Blender: one table, which the `livehand` program joins with Blender's own."""

from __future__ import annotations

import sys

from .benchmark.command import COMMAND as BENCHMARK
from .command import Command, run_commands
from .evaluation.command import COMMAND as EVALUATE
from .evaluation.sheet_command import COMMAND as SHEET
from .importing.interhand_command import COMMAND as IMPORT_INTERHAND
from .importing.mask_command import COMMAND as MASK
from .importing.transforms_command import COMMAND as IMPORT_TRANSFORMS
from .inspect_command import COMMAND as INSPECT
from .portrait_command import COMMAND as PORTRAIT
from .training.command import COMMAND as TRAIN

_COMMANDS = (TRAIN, EVALUATE, BENCHMARK, SHEET, INSPECT, PORTRAIT, IMPORT_INTERHAND, IMPORT_TRANSFORMS, MASK)
COMMANDS: dict[str, Command] = {command.name: command for command in _COMMANDS}

if __name__ == "__main__":
    sys.exit(run_commands("livehand", "LiveHand without Blender", COMMANDS))
