"""`blender --command livehand`: Blender as a module has no command line, so its function is called directly."""

import bpy
import livehand
from livehand.livehand_blender import blender_command
from livehand.livehand_blender.blender_command import BlenderCommand


def test_it_renders_and_returns_the_exit_code(hand_scene, tmp_path, fake_session, capsys):
    path = tmp_path / "wave.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    assert blender_command.run(["render", str(path), "-o", str(tmp_path / "out"), "--frames", "1-2"]) == 0
    assert len(list((tmp_path / "out").glob("*.exr"))) == 2
    assert blender_command.run(["render", str(path)]) == 2
    assert blender_command.run(["capture"]) == 2
    assert blender_command.run(["render", str(tmp_path / "no.blend"), "-o", str(tmp_path / "out")]) == 1
    assert "no file at" in capsys.readouterr().err
    assert hasattr(bpy.types.Scene, "livehand")


def test_it_is_registered_with_the_add_on(monkeypatch):
    calls = []
    monkeypatch.setattr(bpy.utils, "register_cli_command", lambda name, function: calls.append(name) or "handle")
    monkeypatch.setattr(bpy.utils, "unregister_cli_command", calls.append)
    handle = BlenderCommand.handle
    try:
        BlenderCommand.register()
        BlenderCommand.unregister()
    finally:
        BlenderCommand.handle = handle
    assert calls == ["livehand", "handle"]
    assert handle is not None


def test_it_is_unregistered_with_the_add_on():
    livehand.unregister()
    try:
        assert BlenderCommand.handle is None
    finally:
        livehand.register()
