"""Triangles of objects are read once, until their geometry changes or nobody asks for them."""

import bpy
import numpy as np
import pytest
from livehand.livehand_blender.hands.visible_hands import InstanceId
from livehand.livehand_blender.light.solids import LocalTriangles


def add_triangle(name, side_m=1.0):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(0, 0, 0), (side_m, 0, 0), (0, side_m, 0)], [], [(0, 1, 2)])
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


@pytest.fixture
def local():
    """Told of every change, as a view is."""
    made = LocalTriangles()
    bpy.app.handlers.depsgraph_update_post.append(lambda scene, depsgraph: made.forget_changed(depsgraph))
    yield made
    bpy.app.handlers.depsgraph_update_post.pop()


def read(local, thing):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return local.of(thing.evaluated_get(depsgraph))


def test_what_moves_as_a_whole_is_kept_and_what_is_edited_is_read_again(local):
    moved, edited = add_triangle("Moved"), add_triangle("Edited")
    before = [read(local, thing) for thing in (moved, edited)]
    np.testing.assert_array_equal(before[0], [[(0, 0, 0), (1, 0, 0), (0, 1, 0)]])
    moved.location.x = 2
    bpy.context.view_layer.update()
    assert [read(local, moved) is before[0], read(local, edited) is before[1]] == [True, True]
    edited.data.vertices[1].co.x = 3
    edited.data.update()
    bpy.context.view_layer.update()
    assert read(local, moved) is before[0]
    np.testing.assert_array_equal(read(local, edited), [[(0, 0, 0), (3, 0, 0), (0, 1, 0)]])


def test_a_modifier_that_another_object_drives_changes_the_triangles(local):
    thing, other = add_triangle("Hooked"), bpy.data.objects.new("Hook", None)
    bpy.context.scene.collection.objects.link(other)
    hook = thing.modifiers.new("Hook", "HOOK")
    hook.object = other
    hook.vertex_indices_set([0])
    bpy.context.view_layer.update()
    assert read(local, thing)[0, 0, 2] == 0
    other.location.z = 5
    bpy.context.view_layer.update()
    assert read(local, thing)[0, 0, 2] == 5


def test_what_is_not_asked_for_is_dropped(local):
    one, other = add_triangle("One"), add_triangle("Other")
    before = [read(local, thing) for thing in (one, other)]
    local.forget_unasked()
    assert read(local, one) is before[0]
    local.forget_unasked()
    assert read(local, one) is before[0]
    assert read(local, other) is not before[1]


def test_a_material_that_changes_is_seen_at_the_next_reading(local):
    material = bpy.data.materials.new("Paint")
    material.use_nodes = True
    colour = material.node_tree.nodes["Principled BSDF"].inputs["Base Color"]
    things = [add_triangle(name) for name in ("One", "Other")]
    for thing in things:
        thing.data.materials.append(material)

    def albedo(thing):
        bpy.context.view_layer.update()
        evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
        return local.solid(InstanceId(thing.name), evaluated, np.eye(4)).albedo

    for grey in (0.25, 0.75):
        colour.default_value = (grey, grey, grey, 1)
        local.forget_unasked()
        for thing in things:
            np.testing.assert_allclose(albedo(thing), [[grey] * 3], atol=1e-6)


def test_an_object_that_rests_stays_the_same_solid(local):
    thing = add_triangle("Thing")

    def solid():
        bpy.context.view_layer.update()
        evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
        return local.solid(InstanceId("Thing"), evaluated, np.array(evaluated.matrix_world))

    first = solid()
    assert solid() is first
    thing.location.y = 2
    moved = solid()
    np.testing.assert_array_equal(moved.triangles, [[(0, 2, 0), (1, 2, 0), (0, 3, 0)]])
    np.testing.assert_allclose(moved.balls[0], [(1 / 3, 7 / 3, 0)])
    local.forget_unasked()
    assert solid() is moved
    for _ in range(2):
        local.forget_unasked()
    assert solid() is not moved
