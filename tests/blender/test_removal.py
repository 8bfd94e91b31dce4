"""Scenes made for a moment are removed without reading the context's window, which a script may not have."""

import ast
from pathlib import Path

import bpy
import livehand
import pytest
from livehand.livehand_blender.scene.removal import remove_scene


def test_a_scene_and_what_was_made_for_it_are_removed_without_a_window():
    before = {kind: len(getattr(bpy.data, kind)) for kind in ("scenes", "objects", "cameras")}
    scene, lens = bpy.data.scenes.new("Moment"), bpy.data.cameras.new("Moment")
    camera = bpy.data.objects.new("Moment", lens)
    scene.collection.objects.link(camera)
    scene.camera = camera
    with bpy.context.temp_override(window=None):
        remove_scene(scene, (camera, lens))
    assert {kind: len(getattr(bpy.data, kind)) for kind in before} == before


def test_a_scene_that_a_window_shows_is_not_removed():
    with pytest.raises(ValueError, match="must not be shown by a window"):
        remove_scene(bpy.context.window.scene)


def test_no_other_function_removes_a_scene():
    """`scenes.remove` crashes Blender 4.3 where the context has no window; it cannot be seen to here."""
    source = Path(livehand.__file__).parent / "livehand_blender"
    calls = [
        f"{path.name}:{node.lineno}"
        for path in source.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and node.attr == "remove" and ast.unparse(node.value).endswith("data.scenes")
    ]
    assert calls == []
