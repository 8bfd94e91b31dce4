"""Cameras of 3D views against Blender's own projection matrices, and the render border in them."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from livehand.livehand_blender.render.viewport_view import read_view, region_camera
from livehand.livehand_blender.scene.camera import read_camera
from mathutils import Matrix

REGION_PX = (300, 200)
# What a camera view does to the camera's own projection: it scales and moves the image in the region.
ZOOM, OFFSET = np.array([0.6, 0.9]), np.array([0.15, -0.1])


@pytest.fixture
def camera(hand_scene):
    """The scene's camera, turned, with a lens shift, before an image of 48 x 64 px."""
    camera = hand_scene.camera
    camera.rotation_euler = (0.3, -0.2, 0.5)
    camera.data.shift_x, camera.data.shift_y = 0.1, -0.05
    bpy.context.view_layer.update()
    return camera


def camera_view(camera, perspective="CAMERA"):
    """A 3D view's matrices when it looks through the camera."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    render = bpy.context.scene.render
    image = camera.calc_matrix_camera(depsgraph, x=render.resolution_x, y=render.resolution_y)
    zoom = Matrix.Diagonal((*ZOOM, 1, 1))
    zoom[0][3], zoom[1][3] = OFFSET
    return SimpleNamespace(
        window_matrix=zoom @ image,
        view_matrix=camera.matrix_world.normalized().inverted(),
        view_perspective=perspective,
    )


def context_of(view, **space):
    space = {"use_render_border": False, "use_local_camera": False, "region_3d": view} | space
    region = SimpleNamespace(width=REGION_PX[0], height=REGION_PX[1])
    return SimpleNamespace(region=region, space_data=SimpleNamespace(**space), region_data=view)


def in_region(view, points):
    """Pixels from the upper left, by the matrices that Blender draws with."""
    clip = np.concatenate([points, np.ones((len(points), 1))], 1) @ np.array(view.window_matrix @ view.view_matrix).T
    across, up = (clip[:, :2] / clip[:, 3:]).T
    return np.stack([(across + 1) / 2 * REGION_PX[0], (1 - up) / 2 * REGION_PX[1]], 1)


def points_before(camera):
    local = np.random.default_rng(0).uniform(-0.2, 0.2, (20, 3)) - (0, 0, 0.6)
    return local @ np.array(camera.matrix_world)[:3, :3].T + np.array(camera.matrix_world)[:3, 3]


def test_points_are_projected_where_blender_draws_them(camera):
    view = camera_view(camera)
    points = points_before(camera)
    pixels, depth = region_camera(view, REGION_PX).project(points)
    assert pixels == pytest.approx(in_region(view, points), abs=1e-3)
    to_camera = np.array(camera.matrix_world.inverted())
    assert depth == pytest.approx(-(points @ to_camera[2, :3] + to_camera[2, 3]), abs=1e-5)


def test_the_view_through_the_camera_is_the_rendered_image_zoomed(camera):
    scene = bpy.context.scene
    image = read_camera(camera, scene.render)
    view = camera_view(camera)
    points = points_before(camera)
    share = image.project(points)[0] / image.size_px
    device = (2 * share - 1) * (1, -1) * ZOOM + OFFSET
    expected = (device * (1, -1) + 1) / 2 * REGION_PX
    assert region_camera(view, REGION_PX).project(points)[0] == pytest.approx(expected, abs=1e-3)


def test_a_border_in_the_camera_view_cuts_the_region(camera):
    scene = bpy.context.scene
    scene.render.use_border = True
    borders = scene.render
    borders.border_min_x, borders.border_max_x, borders.border_min_y, borders.border_max_y = 0.25, 0.75, 0.5, 1.0
    view = camera_view(camera)
    seen = read_view(context_of(view), bpy.context.evaluated_depsgraph_get())
    device = np.array([[-0.5, 1.0], [0.5, 0.0]]) * ZOOM + OFFSET
    corners = (device * (1, -1) + 1) / 2 * REGION_PX
    assert np.abs(np.array(seen.rectangle) - corners.ravel()).max() <= 0.5
    points = points_before(camera)
    in_rectangle = seen.camera.project(points)[0]
    assert in_rectangle == pytest.approx(in_region(view, points) - seen.rectangle[:2], abs=1e-3)
    assert seen.camera.size_px == seen.rectangle.size_px


def test_a_free_view_has_its_own_border(camera):
    bpy.context.scene.render.use_border = True  # counts in camera views only
    view = camera_view(camera, "PERSP")
    borders = {"render_border_min_x": 0.1, "render_border_max_x": 0.5} | {
        "render_border_min_y": 0.2,
        "render_border_max_y": 0.9,
    }
    depsgraph = bpy.context.evaluated_depsgraph_get()
    assert read_view(context_of(view), depsgraph).rectangle == (0, 0, 300, 200)
    seen = read_view(context_of(view, use_render_border=True, **borders), depsgraph)
    assert seen.rectangle == (30, 20, 150, 160)


def test_a_border_outside_the_region_shows_nothing(camera):
    view = camera_view(camera, "PERSP")
    borders = dict.fromkeys(("render_border_min_x", "render_border_max_x"), 1.0)
    borders |= {"render_border_min_y": 0.0, "render_border_max_y": 1.0}
    depsgraph = bpy.context.evaluated_depsgraph_get()
    assert read_view(context_of(view, use_render_border=True, **borders), depsgraph) is None


@pytest.mark.parametrize("perspective", ["CAMERA", "ORTHO"])
def test_an_orthographic_view_projects_points_where_blender_draws_them(camera, perspective):
    camera.data.type, camera.data.ortho_scale = "ORTHO", 0.7
    view, points = camera_view(camera, perspective), points_before(camera)
    seen = region_camera(view, REGION_PX)
    pixels, depth = seen.project(points)
    assert pixels == pytest.approx(in_region(view, points), abs=1e-3)
    to_camera = np.array(camera.matrix_world.inverted())
    behind = 0 if perspective == "CAMERA" else 100
    assert depth == pytest.approx(behind - (points @ to_camera[2, :3] + to_camera[2, 3]), abs=1e-4)


def test_a_border_in_an_orthographic_camera_view_cuts_the_region(camera):
    camera.data.type, camera.data.ortho_scale = "ORTHO", 0.7
    test_a_border_in_the_camera_view_cuts_the_region(camera)
