"""Hands and scene in one picture: closed forms, order, energy, and real hands cut by a plane."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.field.rays import camera_tensors, project
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.camera import Camera
from livehand.backend.records.depth_profile import DepthProfile
from livehand.backend.records.frame import DEPTH_BACKGROUND, Frame
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.composition import SceneLayer, joined, mean_frame, over, visible_parts
from livehand.backend.render.renderer import Renderer
from numpy.lib.stride_tricks import sliding_window_view

SIZE = (12, 16)  # width, height


def a_frame(
    depth_m, alpha: float | np.ndarray = 1.0, colour=(1.0, 0.5, 0.25), columns=slice(None), samples=4, dt_m=0.001
):
    """A wall that covers some columns: rays of samples of equal weight, about `depth_m` (a number or [h, w])."""
    width, height = SIZE
    covered = np.zeros((height, width), np.float32)
    covered[:, columns] = alpha
    is_hit = covered[::2, ::2] > 0
    row = np.where(is_hit, np.cumsum(is_hit).reshape(is_hit.shape) - 1, -1).astype(np.int32).repeat(2, 0).repeat(2, 1)
    middle = np.broadcast_to(depth_m, is_hit.shape)[is_hit][:, None]
    t = (middle + (np.arange(samples) - (samples - 1) / 2) * dt_m).astype(np.float32)
    weights = np.full(t.shape, alpha / samples, np.float32)
    depth = np.where(covered > 0.5, np.repeat(np.repeat(np.broadcast_to(depth_m, is_hit.shape), 2, 0), 2, 1), 1e10)
    profile = DepthProfile(row, t, np.full(len(t), dt_m, np.float32), weights, ray_px=2)
    return Frame(covered[..., None] * np.float32(colour), covered, depth.astype(np.float32), profile)


def scene_at(depth_m):
    return np.full(SIZE[::-1], depth_m, np.float32)


def test_a_hand_alone_is_left_as_it_is():
    frame = a_frame(1.0)
    assert visible_parts([frame]) == [frame]


@pytest.mark.parametrize(
    ("wall_m", "share"), [(0.9, 0), (0.998, 0), (0.999, 0.25), (1.0, 0.5), (1.0005, 0.625), (1.002, 1), (1e10, 1)]
)
def test_a_wall_within_the_skin_lets_through_what_lies_before_it(wall_m, share):
    frame = a_frame(1.0, alpha=0.8)
    (part,) = visible_parts([frame], scene_at(wall_m))
    np.testing.assert_allclose(part.alpha, 0.8 * share, atol=2e-4)
    np.testing.assert_allclose(part.rgb, frame.rgb * share, atol=2e-4)
    assert ((part.depth == DEPTH_BACKGROUND) == (0.8 * share < 0.5)).all()


def test_a_walls_edge_is_sharp_to_a_pixel_also_within_one_ray():
    wall = scene_at(10.0)
    wall[:, :5] = 0.5  # an odd column: through the middle of a ray's 2 x 2 pixels
    (part,) = visible_parts([a_frame(1.0)], wall)
    np.testing.assert_array_equal(part.alpha[:, :4], 0)
    np.testing.assert_array_equal(part.alpha[:, 6:], 1)
    np.testing.assert_allclose(part.alpha[:, 4:6], np.broadcast_to([0.25, 0.75], (16, 2)))


def test_two_hands_hide_each_other_by_depth_whatever_their_order():
    front, behind = a_frame(1.0, 0.6, (1, 0, 0)), a_frame(1.1, 0.9, (0, 1, 0))
    for frames in ([front, behind], [behind, front]):
        parts = visible_parts(frames)
        whole = joined(parts)
        np.testing.assert_allclose(whole.rgb, np.broadcast_to([0.6, 0.9 * 0.4, 0], whole.rgb.shape), atol=1e-6)
        np.testing.assert_allclose(whole.alpha, 1 - 0.4 * 0.1, atol=1e-6)
    one, other = (joined(visible_parts(frames)) for frames in ([front, behind], [behind, front]))
    np.testing.assert_array_equal(one.rgb, other.rgb)
    np.testing.assert_array_equal(one.alpha, other.alpha)
    np.testing.assert_array_equal(one.depth, other.depth)


def test_hands_that_pass_through_each_other_change_places_where_they_cross():
    slope = np.linspace(0.98, 1.02, SIZE[0] // 2)
    one, other = a_frame(1.0, colour=(1, 0, 0)), a_frame(slope, colour=(0, 1, 0))
    whole = joined(visible_parts([one, other]))
    assert (whole.rgb[:, -3:] == [1, 0, 0]).all()
    assert (whole.rgb[:, :3] == [0, 1, 0]).all()
    np.testing.assert_allclose(whole.alpha, 1, atol=0.02)
    assert whole.alpha.max() <= 1


def test_interpenetrating_hands_never_give_more_light_than_there_is():
    """Opaque in the same steps: each lets half of the other's step through."""
    parts = visible_parts([a_frame(1.0, colour=(1, 1, 1)), a_frame(1.0, colour=(1, 1, 1))])
    whole = joined(parts)
    assert whole.rgb.max() <= 1 + 1e-6
    np.testing.assert_allclose(whole.alpha, 1, atol=1e-6)
    np.testing.assert_array_equal(parts[0].alpha, parts[1].alpha)


def test_alpha_beside_the_rays_shares_their_fate():
    """Super-resolution leaves a little alpha past the last ray."""
    frame = a_frame(1.0, columns=slice(0, 6))
    alpha = frame.alpha.copy()
    alpha[:, 6:8] = 0.2
    haloed = replace(frame, alpha=alpha)
    (hidden,) = visible_parts([haloed], scene_at(0.5))
    assert hidden.alpha.max() == 0
    (shown,) = visible_parts([haloed], scene_at(2.0))
    np.testing.assert_allclose(shown.alpha, alpha, atol=1e-6)


def test_a_frame_without_a_profile_lies_at_its_depth():
    frame = replace(a_frame(1.0), profile=None)
    assert joined(visible_parts([frame], scene_at(0.9))).alpha.max() == 0
    np.testing.assert_array_equal(joined(visible_parts([frame], scene_at(1.1))).rgb, frame.rgb)


def half_plane(angle_rad, depth_m, colour):
    """A surface left of a straight outline through the middle, as wide as a pixel there."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    distance_px = (x - SIZE[0] / 2) * np.cos(angle_rad) + (y - SIZE[1] / 2) * np.sin(angle_rad)
    alpha = np.clip(0.5 - distance_px, 0, 1).astype(np.float32)
    depth = np.where(alpha >= 0.5, np.float32(depth_m), DEPTH_BACKGROUND).astype(np.float32)
    return Frame(alpha[..., None] * np.float32(colour), alpha, depth)


@pytest.mark.parametrize("angle_rad", [0.0, 0.4, 0.9])
def test_the_outline_of_a_surface_shows_no_seam_before_another_hand(angle_rad):
    """It covers the hand behind by what it shows itself: no rim through which the background is seen."""
    front = half_plane(angle_rad, 0.9, (1, 0, 0))
    behind = replace(a_frame(1.0, colour=(0, 1, 0)), profile=None)
    whole = joined(visible_parts([front, behind]))
    np.testing.assert_allclose(whole.alpha, 1, atol=1e-6)
    np.testing.assert_allclose(whole.rgb[..., 0], front.alpha, atol=1e-6)
    np.testing.assert_allclose(whole.rgb[..., 1], 1 - front.alpha, atol=1e-6)
    below = joined(visible_parts([half_plane(angle_rad, 1.1, (1, 0, 0)), behind]))
    np.testing.assert_allclose(below.rgb, behind.rgb, atol=1e-6)


def test_surfaces_that_cross_change_places_within_a_pixel():
    """A surface of 0.5 mm a column goes through one that is level: the pixel of the crossing shows both."""
    column_m = 1 + 5e-4 * (np.arange(SIZE[0]) - 6)
    sloped = Frame(np.ones((*SIZE[::-1], 3), np.float32), np.ones(SIZE[::-1], np.float32), np.tile(column_m, (16, 1)))
    level = replace(sloped, rgb=np.zeros_like(sloped.rgb), depth=scene_at(1.0))
    seen = joined(visible_parts([sloped, level])).rgb[8, :, 0]
    np.testing.assert_allclose(seen, [1, 1, 1, 1, 1, 1, 0.5, 0, 0, 0, 0, 0], atol=0.02)


@pytest.mark.parametrize("size", [(11, 15), (1, 1), (2, 7)])
def test_odd_sizes(size):
    width, height = size
    depth = np.full((height, width), 1.0, np.float32)
    frame = Frame(np.ones((height, width, 3), np.float32), np.ones((height, width), np.float32), depth)
    (part,) = visible_parts([frame], np.full((height, width), 0.5, np.float32))
    assert part.alpha.shape == (height, width)
    assert part.alpha.max() == 0


def test_over_a_scene():
    hands = joined(visible_parts([a_frame(1.0, 0.75, (1, 0, 0), slice(0, 6))]))
    scene = SceneLayer(np.full((SIZE[1], SIZE[0], 3), 0.4, np.float32), scene_at(0.8), scene_at(3.0))
    whole = over(hands, scene, np.zeros(SIZE[::-1], np.float32))
    np.testing.assert_allclose(whole.rgb[0, 0], [0.75 + 0.1, 0.1, 0.1], atol=1e-6)
    np.testing.assert_allclose(whole.rgb[0, -1], 0.4)
    np.testing.assert_allclose(whole.alpha[0, [0, -1]], [0.75 + 0.25 * 0.8, 0.8])
    np.testing.assert_array_equal(whole.depth[0, [0, -1]], np.float32([1.0, 3.0]))


def test_a_hole_shows_neither_hands_nor_scene():
    hands = joined(visible_parts([a_frame(1.0, 0.75, (1, 0, 0), slice(0, 6))]))
    scene = SceneLayer(np.full((SIZE[1], SIZE[0], 3), 0.4, np.float32), scene_at(0.8), scene_at(3.0))
    hole = np.zeros(SIZE[::-1], np.float32)
    hole[0, 0], hole[0, -1] = 0.25, 0.6
    holed = over(hands, scene, hole)
    np.testing.assert_allclose(holed.rgb[0, 0], [0.75, 0, 0], atol=1e-6)
    np.testing.assert_allclose(holed.rgb[0, -1], 0.4 * 0.4)
    np.testing.assert_allclose(holed.alpha[0, [0, -1]], [0.75, 0.4 * 0.8])
    np.testing.assert_array_equal(holed.depth[0, [0, -1]], np.float32([1.0, DEPTH_BACKGROUND]))


def test_the_mean_of_frames_is_of_light_and_keeps_the_first_depth():
    one, other = a_frame(1.0, columns=slice(0, 6)), a_frame(1.2, columns=slice(6, 12))
    mean = mean_frame([one, other])
    np.testing.assert_allclose(mean.alpha, 0.5)
    np.testing.assert_array_equal(mean.depth, one.depth)
    assert mean_frame([one]) is one


@pytest.fixture(scope="module")
def posed_shot():
    """The built-in hand at rest from above, 334x512."""
    hand = load_default_hand()
    centre = hand.v_template.mean(0)
    cam2world = np.eye(4)
    cam2world[:3, :3] = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]) @ np.diag([1.0, -1, -1])
    cam2world[:3, 3] = centre - 0.5 * cam2world[:3, 2]
    K = np.array([[1200.0, 0, 167], [0, 1200, 256], [0, 0, 1]])
    return Shot(HandPose.rest(), hand.v_template, Camera(K, cam2world, (334, 512)))


@pytest.mark.slow
def test_a_plane_cuts_the_hand_where_it_should(posed_shot):
    """The shipped avatar, cut by a plane that leans 3 mm a pixel: visibility by the mesh's own depth, to a pixel.

    The skin is softer than the mesh and lies up to 2 mm beside it, so a few pixels in a thousand differ.
    """
    frame = Renderer(load_avatar(), load_default_hand(), "cpu").render(posed_shot)
    surface = mesh_depth(posed_shot)
    width, height = posed_shot.camera.size_px
    leaning = np.median(surface[np.isfinite(surface)]) + 0.003 * (np.arange(width) + 0.5 - width / 2)
    plane = np.tile(leaning, (height, 1)).astype(np.float32)
    (part,) = visible_parts([frame], plane)
    is_before = surface < plane
    around = sliding_window_view(np.pad(is_before, 1, mode="edge"), (3, 3))
    is_solid = sliding_window_view(np.pad(frame.alpha > 0.95, 1), (3, 3)).all((2, 3))
    certain = is_solid & (around.all((2, 3)) | ~around.any((2, 3)))
    assert certain.sum() > 20000
    assert 0.2 < is_before[certain].mean() < 0.8
    wrong = np.abs(part.alpha / np.maximum(frame.alpha, 1e-6) - is_before) > 0.02
    assert wrong[certain].mean() < 0.01


def mesh_depth(shot):
    """[H, W] depth of the mesh's nearest front face, m; infinite where there is none."""
    view = camera_tensors(shot.camera, "cpu")
    positions_px, depth = project(view, torch.as_tensor(shot.vertices, dtype=torch.float32))
    hits = rasterise(positions_px, depth, torch.as_tensor(load_default_hand().f), view.size_px)
    width, height = view.size_px
    nearest = torch.full((height * width,), torch.inf)
    nearest.scatter_reduce_(0, hits.pixel[hits.is_front], hits.depth[hits.is_front], "amin")
    return nearest.reshape(height, width).numpy()
