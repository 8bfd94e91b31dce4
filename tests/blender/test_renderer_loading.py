"""Loading a renderer in Blender whose Python lacks packages."""

import sys
from pathlib import Path

import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.session import Device
from livehand.livehand_blender.render.hand_source import load_renderer_in_blender


def test_a_missing_package_is_named_with_its_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "livehand.backend.avatars.file", None)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(LiveHandError, match=r"lacks: torch; install them with: .*pip install"):
        load_renderer_in_blender(Path("light.safetensors"), load_default_hand(), Device())
