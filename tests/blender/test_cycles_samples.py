"""Cycles takes one sample in a context, and nothing is tagged as changed."""

from types import SimpleNamespace

import bpy
import pytest
from livehand.livehand_blender.render.cycles import has_only_hands, one_sample
from livehand.livehand_blender.render.engine import LiveHandRender

DEFAULT = 1024


@pytest.mark.parametrize("samples", [None, 24])
def test_one_sample_in_the_context_only(hand_scene, samples):
    if samples is not None:
        hand_scene.cycles.preview_samples = samples
        hand_scene.update_tag()
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    updates = []
    bpy.app.handlers.depsgraph_update_post.append(lambda *_: updates.append(True))

    def seen():
        return depsgraph.scene_eval.cycles.preview_samples

    try:
        for _ in range(2):
            with one_sample(depsgraph):
                assert seen() == 1
                assert hand_scene.cycles.preview_samples == (samples or DEFAULT)
            assert seen() == (samples or DEFAULT)
            bpy.context.view_layer.update()
        assert not updates
    finally:
        bpy.app.handlers.depsgraph_update_post.pop()


def test_a_scene_that_never_set_anything_of_cycles(hand_scene):
    scene = bpy.data.scenes.new("Plain")
    depsgraph = scene.view_layers[0].depsgraph
    if depsgraph is None:
        bpy.context.window.scene = scene
        depsgraph = bpy.context.evaluated_depsgraph_get()
    with one_sample(depsgraph):
        assert depsgraph.scene_eval.cycles.preview_samples == 1
    assert depsgraph.scene_eval.cycles.preview_samples == DEFAULT


def test_only_hands_are_wanted_or_there(hand_scene):
    def only_hands():
        bpy.context.view_layer.update()
        return has_only_hands(bpy.context.evaluated_depsgraph_get())

    hand_scene.livehand.mode = "SCENE"
    assert only_hands()
    table = bpy.data.objects.new("Table", bpy.data.meshes.new("Table"))
    hand_scene.collection.objects.link(table)
    assert not only_hands()
    hand_scene.livehand.mode = "HAND"
    assert only_hands()
    hand_scene.livehand.mode = "SCENE"
    table.instance_type, table.show_instancer_for_viewport = "VERTS", False
    assert only_hands()
    table.show_instancer_for_viewport = True
    assert not only_hands()


@pytest.mark.parametrize("has_failed", [False, True])
def test_cycles_rests_until_there_is_an_image_unless_there_will_be_none(hand_scene, has_failed):
    """Its path tracing took more of a new user's processor than the kernels that the first picture waits for."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    engine = SimpleNamespace(viewport=SimpleNamespace(has_image=False, has_failed=has_failed))
    with LiveHandRender._cycles_at_rest(engine, depsgraph):
        assert depsgraph.scene_eval.cycles.preview_samples == (DEFAULT if has_failed else 1)
    assert depsgraph.scene_eval.cycles.preview_samples == DEFAULT
