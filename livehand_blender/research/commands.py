"""The commands of `livehand` for research."""

from ...backend.research.comparison.command import COMMAND as COMPARE
from .command import COMMAND as BENCHMARK
from .consistency_command import COMMAND as CONSISTENCY

COMMANDS = (COMPARE, BENCHMARK, CONSISTENCY)
