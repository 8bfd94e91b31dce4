"""Orthographic cameras from shot to frame: the limit of perspective ones that move away as their lens grows longer."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.capture.person import Person
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.light import Lamp, Light, Sky
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.renderer import Renderer
from livehand.backend.render.surface_maps import scene_depth, surface_maps
from livehand.backend.surface.base_surface import surface_of_person

pytestmark = pytest.mark.slow

SIZE, HEIGHT_M, NEAR_M = (66, 88), 0.26, 0.7
FAR_M = 150.0
"""From here the picture of a hand of 0.2 m differs by 0.03 px, and a depth in single precision by 0.02 mm."""
MEAN, MOST = 0.004, 0.02
"""Of the mean light, by which pictures differ from the far camera's: on average, and 99.5 % of the pixels."""
DIRECTION = np.array([0.1, 0.6, 0.2]) / np.linalg.norm([0.1, 0.6, 0.2])
LIGHT = Light(
    (Lamp("point", np.array([1.0, 1.5, 2]), np.array([-0.2, 0.3, 0.3]), radius_m=0.02),), Sky(np.full((4, 8, 3), 0.3))
)


def camera_at(distance_m, is_orthographic):
    px_per_m = SIZE[1] / HEIGHT_M
    focal_px = px_per_m if is_orthographic else px_per_m * distance_m
    K = np.array([[focal_px, 0, SIZE[0] / 2 + 0.3], [0, focal_px, SIZE[1] / 2 - 0.2], [0, 0, 1]])
    return Camera(K, look_at(distance_m * DIRECTION, np.zeros(3), np.array([1.0, 0, 0])), SIZE, is_orthographic)


@pytest.fixture(scope="module", params=["lit", "lit surface", "baked"])
def avatar(request, hand):
    kind, light = ("lit", "linear") if request.param != "baked" else ("light", "baked")
    field = FieldConfig(width=16, planes=((32, 3, 4), (128, 1, 4)), relief=8, light=light)
    made = new_avatar(
        "untrained",
        hand.name,
        hand.sha256,
        AvatarConfig(field, SuperResConfig(kind=kind, width=8, depth=2), SamplerConfig(6, 0.003)),
    )
    if request.param == "lit surface":
        person = Person(melanin=0.2, folds=1.2, veins_mm=0.3)
        made = replace(made, surface=surface_of_person(person, hand.sha256))
    return made


@pytest.fixture(scope="module")
def shot(hand):
    pose = HandPose(np.zeros((16, 3)), np.zeros(10), -hand.joints[4])
    return Shot(pose, posed_vertices(hand, pose), camera_at(NEAR_M, True), LIGHT, hair=0.5)


@pytest.mark.parametrize("backend", [NumbaBackend, ReferenceBackend])
def test_the_picture_is_that_of_a_perspective_camera_very_far_away(hand, avatar, shot, backend):
    renderer = Renderer(avatar, hand, "cpu", backend=backend())
    for one in (shot, replace(shot, quality="preview")):
        found = renderer.render(one)
        far = renderer.render(replace(one, camera=camera_at(FAR_M, False)))
        within = (found.alpha > 0.99) & (far.alpha > 0.99)
        assert within.sum() > 1000
        difference = np.abs(found.rgb - far.rgb).max(-1) / far.rgb[within].mean()
        assert difference.mean() < MEAN
        assert np.quantile(difference, 0.995) < MOST
        assert np.abs(found.alpha - far.alpha).mean() < MEAN
        assert np.quantile(np.abs(found.depth - (far.depth - FAR_M + NEAR_M))[within], 0.995) < 2e-4


def test_it_is_not_that_of_a_near_perspective_camera(hand, avatar, shot):
    """Which the bounds tell apart."""
    renderer = Renderer(avatar, hand, "cpu")
    found, near = renderer.render(shot), renderer.render(replace(shot, camera=camera_at(NEAR_M, False)))
    assert np.abs(found.alpha - near.alpha).mean() > 3 * MEAN


def test_a_picture_of_one_projection_is_not_kept_for_the_other(hand, avatar, shot):
    renderer = Renderer(avatar, hand, "cpu")
    ours = renderer.render(shot)
    theirs = renderer.render(replace(shot, camera=replace(shot.camera, is_orthographic=False)))
    assert not np.array_equal(ours.alpha, theirs.alpha)
    np.testing.assert_array_equal(renderer.render(shot).rgb, ours.rgb)


def test_the_maps_of_passes_are_those_of_the_far_camera(hand, shot):
    found, far = surface_maps(shot, hand), surface_maps(replace(shot, camera=camera_at(FAR_M, False)), hand)
    seen = (found.uv[..., 2] > 0) & (far.uv[..., 2] > 0)
    assert (found.uv[..., 2] != far.uv[..., 2]).mean() < 0.01
    np.testing.assert_allclose(found.position[seen], far.position[seen], atol=2e-3)
    assert np.median(np.abs(found.position - far.position)[seen]) < 5e-5
    # In the picture the points lie where the pixels are.
    px, depth = shot.camera.project(found.position[seen].astype(float))
    rows, columns = np.nonzero(seen)
    np.testing.assert_allclose(px, np.stack([columns, rows], -1) + 0.5, atol=1e-3)
    np.testing.assert_allclose(depth, found.depth[seen], atol=1e-6)


def test_the_depth_of_passes_is_linear_on_screen(hand, shot):
    """A hand that is flattened onto a plane through the camera's view, as steep that its faces' corners lie apart."""
    cam2world = shot.camera.cam2world
    in_camera = (shot.vertices - cam2world[:3, 3]) @ cam2world[:3, :3]
    depth = NEAR_M + 3 * in_camera[:, 0]
    flat = np.column_stack([in_camera[:, :2], depth]) @ cam2world[:3, :3].T + cam2world[:3, 3]
    found = surface_maps(replace(shot, vertices=flat), hand)
    seen = found.uv[..., 2] > 0
    x = (np.arange(SIZE[0]) + 0.5 - shot.camera.K[0, 2]) / shot.camera.K[0, 0]
    assert seen.sum() > 1000
    np.testing.assert_allclose(found.depth[seen], np.broadcast_to(NEAR_M + 3 * x, seen.shape)[seen], atol=2e-6)


def test_the_scenes_depth_is_linear_on_screen():
    """A plane that is tilted from depth 0.2 to 0.8 across the image."""
    camera = Camera(np.diag([10.0, 10, 1]), np.eye(4), (10, 10), is_orthographic=True)
    a, b, c, d = np.array([[0, 0, 0.2], [1, 0, 0.8], [1, 1, 0.8], [0, 1, 0.2]])
    depth = scene_depth(np.array([[a, b, c], [a, c, d]]), camera)
    np.testing.assert_allclose(depth, np.broadcast_to(0.2 + 0.6 * (np.arange(10) + 0.5) / 10, (10, 10)), rtol=1e-6)


def test_what_lies_behind_the_camera_is_not_shown(hand, avatar, shot):
    behind = replace(shot, camera=replace(shot.camera, cam2world=camera_at(-NEAR_M, True).cam2world))
    behind.camera.cam2world[:3, :3] = shot.camera.cam2world[:3, :3]
    assert Renderer(avatar, hand, "cpu").render(behind).alpha.max() == 0
