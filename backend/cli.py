"""The commands that need no Blender: one table, which the `livehand` program joins with Blender's own."""

from __future__ import annotations

import sys

from .benchmark.command import COMMAND as BENCHMARK
from .command import Command, run_commands
from .evaluation.command import COMMAND as EVALUATE
from .evaluation.sheet_command import COMMAND as SHEET
from .inspect_command import COMMAND as INSPECT
from .training.command import COMMAND as TRAIN

COMMANDS: dict[str, Command] = {command.name: command for command in (TRAIN, EVALUATE, BENCHMARK, SHEET, INSPECT)}

if __name__ == "__main__":
    sys.exit(run_commands("livehand", "LiveHand without Blender", COMMANDS))
