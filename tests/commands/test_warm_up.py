"""What `livehand warm-up` renders and says. That kernels stay on disk is tested with their cache."""

import json
import sys

import pytest
from livehand.backend.commands import warm_up
from livehand.backend.render import backends
from livehand.backend.render.renderer import Renderer
from livehand.backend.system.command import run_commands

COMMANDS = {"warm-up": warm_up.COMMAND}


def test_it_renders_what_needs_every_kernel_and_names_their_folder(monkeypatch, capsys, tmp_path):
    seen = []
    monkeypatch.setattr(Renderer, "render", lambda self, shot: seen.append((self.precision, shot)))
    monkeypatch.setattr(backends, "kernel_cache", lambda: tmp_path)
    assert run_commands("livehand", "", COMMANDS, ["warm-up", "--json"]) == 0
    said = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert said["compiled"]
    assert said["folder"] == str(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["prepared"]
    assert {precision for precision, _ in seen} == {"bf16", "fp32"}
    lights = [shot.light for _, shot in seen[:3]]
    assert lights[0] is None
    assert [len(light.occluders) for light in lights[1:]] == [0, 1]
    assert all(light.lamps and light.sky for light in lights[1:])
    for _, shot in seen:  # the hand is in the picture
        positions_px, depth = shot.camera.project(shot.vertices)
        assert depth.min() > 0
        assert (positions_px > 0).all()
        assert (positions_px < 64).all()


def test_without_numba_it_says_that_there_is_nothing_to_do(monkeypatch, capsys):
    monkeypatch.setattr(backends, "has_numba", lambda: False)
    assert run_commands("livehand", "", COMMANDS, ["warm-up"]) == 0
    assert "numba is not installed" in capsys.readouterr().out


def test_chips_that_are_no_compute_capabilities_are_refused_in_words(capsys):
    assert run_commands("livehand", "", COMMANDS, ["warm-up", "--gpu", "ampere"]) == 2
    assert "such as 8.6,8.9, got 'ampere'" in capsys.readouterr().err


def test_kernels_of_gpus_without_warp_name_the_extra(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "warp", None)
    assert run_commands("livehand", "", COMMANDS, ["warm-up", "--gpu", "8.6"]) == 1
    assert "livehand[gpu]" in capsys.readouterr().err


def test_kernels_of_gpus_are_compiled_for_the_chips_that_are_named(monkeypatch, capsys, tmp_path):
    ahead = pytest.importorskip("livehand.backend.compute.gpu.ahead")
    asked, file = [], tmp_path / "one.cubin"
    file.write_bytes(b"12345")
    done = ahead.CompiledKernels(tmp_path, (file,), 3.21)
    monkeypatch.setattr(ahead, "compile_kernels", lambda chips: asked.append(chips) or done)
    assert run_commands("livehand", "", COMMANDS, ["warm-up", "--gpu", "8.6,12.0", "--json"]) == 0
    assert asked == [(86, 120)]
    said = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (said["bytes"], said["seconds"], said["folder"]) == (5, 3.2, str(tmp_path))
