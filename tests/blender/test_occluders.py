"""The triangles of the scene that may shadow a hand."""

import bpy
import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.light import Lamp
from livehand.livehand_blender.hands.shot import world_vertices
from livehand.livehand_blender.hands.visible_hands import InstanceId
from livehand.livehand_blender.light import occluders
from livehand.livehand_blender.light.light import read_light, read_scene_light
from livehand.livehand_blender.light.reach import Reach, bounding_balls
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import find_hands, mesh_of


@pytest.fixture
def sun(hand_scene):
    """A sun from straight above."""
    lamp = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    hand_scene.collection.objects.link(lamp)
    return lamp


def add_triangle(location, name="Triangle", side_m=0.02):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(0, 0, 0), (side_m, 0, 0), (0, side_m, 0)], [], [(0, 1, 2)])
    thing = bpy.data.objects.new(name, mesh)
    thing.location = location
    bpy.context.scene.collection.objects.link(thing)
    return thing


def hand_meshes():
    depsgraph = bpy.context.evaluated_depsgraph_get()
    meshes = [mesh_of(hand).evaluated_get(depsgraph) for hand in find_hands(bpy.context.scene)]
    return depsgraph, {mesh.original.name_full: world_vertices(mesh) for mesh in meshes}


def off_hand(x, y, z):
    """A place by its offset from the middle of the only hand, m."""
    (vertices,) = hand_meshes()[1].values()
    return np.mean(vertices, axis=0) + np.array([x, y, z])


def light_now():
    depsgraph, hands = hand_meshes()
    ((name, vertices),) = hands.items()
    return read_light(depsgraph, name, vertices)


def test_what_stands_before_the_sun_and_casts_shadows(sun):
    over = add_triangle(off_hand(0, 0, 1.0))
    add_triangle(off_hand(1.0, 0, 1.0), "Aside")
    add_triangle(off_hand(0, 0, 9.0), "Far")
    add_triangle(off_hand(0, 0, -1.0), "Below")
    add_triangle(off_hand(0, 0, 1.1), "Shadowless").visible_shadow = False
    hidden = add_triangle(off_hand(0, 0, 1.2), "Hidden")
    hidden.hide_render = hidden.hide_viewport = True
    (triangle,) = light_now().occluders
    np.testing.assert_allclose(triangle[0], over.location, atol=1e-6)
    np.testing.assert_allclose(triangle[2] - triangle[0], [0, 0.02, 0], atol=1e-6)
    over.visible_camera = False
    assert len(light_now().occluders) == 1


def test_all_round_the_hand_under_a_sky_or_without(sun, hand_scene):
    """What does not shadow the hand may shed light on it."""
    add_triangle(off_hand(0, 0, -0.4), "Near below")
    add_triangle(off_hand(0, 0, -1.0), "Far below")
    assert len(light_now().occluders) == 1
    hand_scene.world = bpy.data.worlds.new("Grey")
    assert len(light_now().occluders) == 1


def test_occluders_have_the_albedo_of_their_materials(sun):
    """A base colour of the material of each face, by its slot; 0.8 without a material."""
    thing = add_triangle(off_hand(0, 0, 0.3))
    np.testing.assert_allclose(light_now().occluder_albedo, [[0.8, 0.8, 0.8]])
    for colour in ((0.1, 0.2, 0.3, 1), (0.7, 0.1, 0, 1)):
        material = bpy.data.materials.new("Paint")
        material.use_nodes = True
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = colour
        thing.data.materials.append(material)
    np.testing.assert_allclose(light_now().occluder_albedo, [[0.1, 0.2, 0.3]], atol=1e-6)
    thing.data.polygons[0].material_index = 1
    thing.data.update()
    np.testing.assert_allclose(light_now().occluder_albedo, [[0.7, 0.1, 0]], atol=1e-6)


def test_instances_and_curves_count(sun):
    source = add_triangle((5, 5, 5))
    collection = bpy.data.collections.new("Leaves")
    collection.objects.link(source)
    for height in (0.5, 1.0):
        empty = bpy.data.objects.new("Empty", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        empty.location = off_hand(-5, -5, height - 5)
        bpy.context.scene.collection.objects.link(empty)
    assert sorted(np.round(light_now().occluders[:, 0, 2] - off_hand(0, 0, 0)[2], 4)) == [0.5, 1.0]
    curve = bpy.data.curves.new("Ring", "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.002
    spline = curve.splines.new("POLY")
    spline.points.add(1)
    spline.points[1].co = (0.03, 0, 0, 1)
    ring = bpy.data.objects.new("Ring", curve)
    ring.location = off_hand(0, 0, 0.3)
    bpy.context.scene.collection.objects.link(ring)
    assert len(light_now().occluders) > 10


def test_instances_of_geometry_nodes_count(sun):
    holder = add_triangle(off_hand(0, 0, 0.7), "Holder")
    tree = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    line, cube = tree.nodes.new("GeometryNodeMeshLine"), tree.nodes.new("GeometryNodeMeshCube")
    scatter, out = tree.nodes.new("GeometryNodeInstanceOnPoints"), tree.nodes.new("NodeGroupOutput")
    line.inputs["Count"].default_value = 3
    line.inputs["Offset"].default_value = (0, 0, 0.2)
    cube.inputs["Size"].default_value = (0.01, 0.01, 0.01)
    tree.links.new(line.outputs[0], scatter.inputs["Points"])
    tree.links.new(cube.outputs["Mesh"], scatter.inputs["Instance"])
    tree.links.new(scatter.outputs[0], out.inputs[0])
    holder.modifiers.new("Scatter", "NODES").node_group = tree
    bpy.context.view_layer.update()
    triangles = light_now().occluders
    assert len(triangles) == 36
    np.testing.assert_allclose(
        np.unique(np.round(triangles[..., 2].mean(1) - off_hand(0, 0, 0)[2], 1)), [0.7, 0.9, 1.1]
    )


def test_hands_shadow_each_other_but_their_own_meshes_are_none_of_their_occluders(sun):
    other = add_hand(bpy.context, load_default_hand().for_side("left"), name="Other")
    other.location = (0, 0, 0.3)
    bpy.context.view_layer.update()
    depsgraph, hands = hand_meshes()
    lights = read_scene_light(depsgraph, {InstanceId(name): one for name, one in hands.items()}, is_final=True)
    count = len(load_default_hand().f)
    low, high = (lights[InstanceId(name)].occluders.triangles for name in ("LiveHand Mesh", "Other Mesh"))
    assert 0.5 * count < len(low) <= count
    assert low[..., 2].mean() > 0.2
    assert 0 < len(high) <= count  # the sun is above it, but the lower hand sheds light on it
    assert high[..., 2].mean() < 0.1


def test_of_too_many_the_nearest_are_kept(sun, monkeypatch, caplog):
    for k in range(6):
        add_triangle(off_hand(0, 0, 2.0 - 0.25 * k), f"Triangle {k}")
    monkeypatch.setattr(occluders, "_MAX_TRIANGLES", 2)
    kept = light_now().occluders
    np.testing.assert_allclose(sorted(kept[:, 0, 2] - off_hand(0, 0, 0)[2]), [0.75, 1.0], atol=1e-5)
    assert "6 triangles may shadow 'LiveHand Mesh': the nearest 2 do" in caplog.text


@pytest.mark.parametrize("seed", range(5))
def test_no_triangle_that_shadows_the_hand_is_lost(seed):
    """Rays from points of the hand to points of a lamp are cut by triangles: each of these is within the reach."""
    rng = np.random.default_rng(seed)
    vertices = rng.normal(0, 0.05, (50, 3))
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    lamps = [
        Lamp("area", np.ones(3), rng.normal(0, 1, 3), rotation * np.linalg.det(rotation), size_m=(0.8, 0.3)),
        Lamp("point", np.ones(3), rng.normal(0, 1, 3), radius_m=0.2),
        Lamp("point", np.ones(3), rng.normal(0, 1, 3), radius_m=0.01),
    ]
    for lamp in lamps:
        reach = Reach.of(vertices, [lamp], 0.0)
        local = rng.uniform(-0.5, 0.5, (200, 3)) * [*lamp.size_m, 0] if lamp.kind == "area" else None
        ball = rng.normal(size=(200, 3))
        on_lamp = (
            local @ lamp.rotation.T
            if local is not None
            else lamp.radius_m * ball / np.linalg.norm(ball, axis=1)[:, None]
        )
        share = rng.uniform(0, 1, (200, 1))
        cut = (1 - share) * vertices[rng.integers(0, 50, 200)] + share * (lamp.position + on_lamp)
        triangles = cut[:, None] + rng.normal(0, 0.01, (200, 3, 3)) * [[[1], [1], [0]]]
        triangles[:, 2] = 3 * cut - triangles[:, 0] - triangles[:, 1]  # the cut is the centroid
        assert reach.touches(*bounding_balls(triangles)).all()
