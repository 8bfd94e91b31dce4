"""How tests start and end, and which files are read. What they share is in `fixtures`."""

import re
import signal
import sys

import pytest
from livehand.backend.system.process_end import end_process

EXIT_STATUS = pytest.StashKey[int]()
ALL_SLOW = re.compile(r"^pytestmark = .*pytest\.mark\.slow\b", re.MULTILINE)


def pytest_configure(config):
    """Give this process and its children the signals of a program in the foreground; and fixtures, where tests run.

    The process that only hands tests to others waits for no torch.
    """
    if hasattr(config, "workerinput") or not getattr(config.option, "tx", None):
        config.pluginmanager.import_plugin("livehand.tests.fixtures")
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_ignore_collect(collection_path, config):
    """Leave files of slow tests alone unread where those are not asked for: their imports take long."""
    if "not slow" in config.option.markexpr and collection_path.suffix == ".py":
        return True if ALL_SLOW.search(collection_path.read_text(encoding="utf-8")) else None


def pytest_sessionfinish(session, exitstatus):
    """Keep the exit status for `pytest_unconfigure`."""
    session.config.stash[EXIT_STATUS] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    """End the process as the program does: Blender's own end may wait for ever."""
    if "bpy" in sys.modules and EXIT_STATUS in config.stash:
        end_process(config.stash[EXIT_STATUS])
