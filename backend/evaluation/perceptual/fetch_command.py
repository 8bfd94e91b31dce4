"""`livehand fetch-perceptual`: the one command that brings LPIPS' networks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ...system.package_files import fetch_command
from .lpips_package import PACKAGE


def _keep(found: Mapping[str, bytes]) -> Path:
    from .fetched import keep_lpips

    return keep_lpips(found)


COMMAND = fetch_command("fetch-perceptual", "fetch the networks of LPIPS, once", PACKAGE, _keep)
