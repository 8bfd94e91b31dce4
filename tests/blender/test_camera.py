"""Blender's camera -> K and cam2world, against Blender's own projection."""

import itertools

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from livehand.backend.records.errors import LiveHandError
from livehand.livehand_blender.scene.camera import image_size_px, output_size_px, read_camera, render_region
from mathutils import Euler, Matrix, Vector

TOLERANCE_PX = 1e-3
POINTS_IN_CAMERA = np.random.default_rng(0).uniform((-0.4, -0.4, -3), (0.4, 0.4, -0.3), (20, 3))


@pytest.fixture
def camera():
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.3, -1.1, 0.4), (1.2, 0.1, 0.3)
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    return camera


def evaluated(camera):
    return camera.evaluated_get(bpy.context.evaluated_depsgraph_get())


def blender_pixels(camera, render):
    """World points, and where Blender's projection matrix puts them, px from the upper left."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    width, height = image_size_px(render)
    projection = evaluated(camera).calc_matrix_camera(
        depsgraph, x=width, y=height, scale_x=render.pixel_aspect_x, scale_y=render.pixel_aspect_y
    )
    to_world = evaluated(camera).matrix_world.normalized()
    points = np.array([to_world @ Vector(point) for point in POINTS_IN_CAMERA])
    clip = np.array([projection @ Vector((*point, 1)) for point in POINTS_IN_CAMERA])
    ndc = clip[:, :2] / clip[:, 3:]
    return points, (ndc * (1, -1) + 1) / 2 * (width, height)


def largest_error_px(camera, render):
    points, expected = blender_pixels(camera, render)
    pixels, depth = read_camera(evaluated(camera), render).project(points)
    assert np.allclose(depth, -POINTS_IN_CAMERA[:, 2], atol=1e-5)
    return np.abs(pixels - expected).max()


FITS = ("AUTO", "HORIZONTAL", "VERTICAL")
SIZES = ((334, 512, 100), (1920, 1080, 37), (512, 512, 100))
SHIFTS = ((0, 0), (0.13, -0.21))
ASPECTS = ((1, 1), (1.5, 1), (1, 1.8))
LENSES = (("MILLIMETERS", 24.0), ("FOV", 0.4))
WIDTHS_M = (0.3, 2.1)


def test_projects_like_blender_for_all_lenses_fits_shifts_sizes_and_aspects(camera):
    render, lens = bpy.context.scene.render, camera.data
    lens.sensor_width, lens.sensor_height = 31.0, 17.0
    worst = 0.0
    for _ in every_image_of(camera):
        for unit, value in LENSES:
            lens.lens_unit = unit
            setattr(lens, "lens" if unit == "MILLIMETERS" else "angle", value)
            worst = max(worst, largest_error_px(camera, render))
    assert worst < TOLERANCE_PX


def every_image_of(camera):
    render, lens = bpy.context.scene.render, camera.data
    for fit, size, shift, aspect in itertools.product(FITS, SIZES, SHIFTS, ASPECTS):
        lens.sensor_fit, (lens.shift_x, lens.shift_y) = fit, shift
        render.resolution_x, render.resolution_y, render.resolution_percentage = size
        render.pixel_aspect_x, render.pixel_aspect_y = aspect
        yield


def test_projects_like_blender_for_all_orthographic_scales_fits_shifts_sizes_and_aspects(camera):
    camera.data.type = "ORTHO"
    worst = 0.0
    for _ in every_image_of(camera):
        for width_m in WIDTHS_M:
            camera.data.ortho_scale = width_m
            worst = max(worst, largest_error_px(camera, bpy.context.scene.render))
    assert worst < TOLERANCE_PX
    assert read_camera(evaluated(camera), bpy.context.scene.render).is_orthographic


def test_agrees_with_world_to_camera_view(camera):
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = 334, 512
    camera.data.shift_y = 0.2
    points, _ = blender_pixels(camera, render)
    view = np.array([world_to_camera_view(bpy.context.scene, camera, Vector(point)) for point in points])
    pixels, depth = read_camera(evaluated(camera), render).project(points)
    assert np.abs(pixels - (view[:, :2] * (1, -1) + (0, 1)) * (334, 512)).max() < TOLERANCE_PX
    assert np.allclose(depth, view[:, 2], atol=1e-5)


def test_scale_of_the_camera_and_of_its_parent_does_not_matter(camera):
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale, parent.rotation_euler, camera.scale = (0.1, 0.1, 0.1), (0.2, 0.3, 0.4), (2, 3, 4)
    camera.parent = parent
    bpy.context.view_layer.update()
    assert largest_error_px(camera, bpy.context.scene.render) < TOLERANCE_PX


@pytest.mark.parametrize(
    "matrix",
    [Matrix.Diagonal((-1, 1, 1, 1)), Matrix.Diagonal((1, 2, 1, 1)) @ Euler((0.5, 0.5, 0.5)).to_matrix().to_4x4()],
    ids=["mirrored", "sheared"],
)
def test_a_mirrored_or_sheared_camera_is_an_error(camera, matrix):
    camera.rotation_euler, camera.location = (0, 0, 0), (0, 0, 0)
    camera.parent = bpy.data.objects.new("Parent", None)
    camera.matrix_parent_inverse = matrix
    bpy.context.scene.collection.objects.link(camera.parent)
    bpy.context.view_layer.update()
    with pytest.raises(LiveHandError, match="remove the scale"):
        read_camera(evaluated(camera), bpy.context.scene.render)


def test_a_panoramic_camera_is_an_error(camera):
    camera.data.type = "PANO"
    with pytest.raises(LiveHandError, match="orthographic cameras only, 'Camera' is PANO; set its lens type"):
        read_camera(evaluated(camera), bpy.context.scene.render)


def test_no_camera_is_an_error():
    with pytest.raises(LiveHandError, match="needs a camera"):
        read_camera(None, bpy.context.scene.render)


def test_the_border_is_rounded_as_blender_does():
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 335, 511, 50
    assert image_size_px(render) == (167, 255)
    render.use_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.1, 0.35
    region = render_region(render)
    # columns 41..125 of 167; rows 25..89 of 255 from the bottom
    assert (region.x0_px, region.y0_px, region.size_px) == (41, 255 - 89, (84, 64))
    assert output_size_px(render) == (167, 255)
    render.use_crop_to_border = True
    assert output_size_px(render) == (84, 64)


def test_an_empty_border_is_an_error():
    render = bpy.context.scene.render
    render.use_border, render.border_min_x, render.border_max_x = True, 0.5, 0.5
    with pytest.raises(LiveHandError, match="at least one pixel"):
        render_region(render)
