"""Processes share the kernels of a first picture: together they compile all, and none that another one has."""

import json
import os
import subprocess
import sys

import pytest
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.compute.cpu.backend import NumbaBackend, share_of_backend
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.render.ahead import kernels

REPORT_COMPILED = """
import json, sys
from numba.core import event
compiled = []

class Listener(event.Listener):
    def on_start(self, event):
        pass

    def on_end(self, event):
        dispatcher = event.data["dispatcher"]
        if ".kernels." in dispatcher.py_func.__module__:
            compiled.append(dispatcher.py_func.__qualname__)

event.register("numba:compile", Listener())
from dataclasses import replace
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.render.ahead import kernels

def end():
    print(json.dumps(compiled))
    sys.exit()

qualities, share = json.loads(sys.argv[1])
if share:
    kernels.prepare_share(shipped_avatar_path(), *share, end if qualities == ["preview"] else lambda: None)
else:
    from livehand.backend.hand.model_file import load_default_hand
    from livehand.backend.avatars.file import load_avatar
    from livehand.backend.render.renderer import Renderer
    hand = load_default_hand()
    renderer = Renderer(load_avatar(shipped_avatar_path()), hand, "cpu")
    for shot in kernels._shots(hand):
        for quality in qualities:
            renderer.render(replace(shot, quality=quality))
end()
"""


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_shares_are_together_the_whole_backend(count):
    overridden = [_stages(share_of_backend(number, count)) for number in range(count)]
    assert set.union(*overridden) == _stages(NumbaBackend()) - {"shade", "frames_at_once", "threads_of_frame"}
    assert sum(map(len, overridden)) == len(set.union(*overridden))
    assert all(overridden)


def _stages(backend):
    return {name for name in dir(backend) if not name.startswith("_") and name in _kernels(type(backend))}


def _kernels(backend):
    return {name for base in backend.__mro__ if base.__module__.startswith(f"{CPU}.") for name in vars(base)}


CPU = "livehand.backend.compute.cpu"


def test_a_share_is_prepared_by_kernels_and_reference(monkeypatch):
    """Without a surface there is nothing that skin detail would be made for."""
    made, rendered = [], []

    class Renderer:
        def __init__(self, avatar, hand, device, **options):
            made.append(options)

        def render(self, shot):
            rendered.append(shot.quality)

    monkeypatch.setattr("livehand.backend.render.renderer.Renderer", Renderer)
    for number in range(4):
        kernels.prepare_share(shipped_avatar_path(), number, 4, lambda: rendered.append("first"))
    assert rendered == 4 * ["preview", "first", "final"]
    assert all(isinstance(options["backend"], ReferenceBackend) for options in made)
    assert [options["has_skin_detail"] for options in made] == [False, False, True, False]


@pytest.mark.nightly
@pytest.mark.parametrize("qualities", [["preview"], ["preview", "final"]])
def test_the_first_pictures_compile_nothing_after_the_shares(tmp_path, qualities):
    """A view's coarse one after each share has said that it is ready, the finished one after all shares."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    def compiled(share):
        command = [sys.executable, "-c", REPORT_COMPILED, json.dumps([qualities, share])]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return json.loads(done.stdout.splitlines()[-1])

    shares = [compiled([number, 2]) for number in range(2)]
    assert all(shares)
    assert compiled(None) == []
