"""`livehand fetch-tracker`: the one command that brings the hand tracker's networks."""

from __future__ import annotations

from ..system.package_files import fetch_command
from .weights import PACKAGE, keep_networks

COMMAND = fetch_command("fetch-tracker", "fetch the networks of the hand tracker, once", PACKAGE, keep_networks)
