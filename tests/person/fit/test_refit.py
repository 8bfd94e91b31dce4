"""Pictures made smaller for the fit, and offsets by outlines against a known swelling, seen from all around."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.geometry.mesh_tables import area_weighted_normals
from livehand.backend.person.fit.pose_targets import OutlineTargets, PoseTargets
from livehand.backend.person.fit.refit import made_smaller, outline_offsets
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.hand_picture import HAND, HandPicture
from livehand.backend.records.shot import HandPose
from livehand.tests.person.conftest import middle_person

VIEWS, OFF_M = 16, 0.001
K = np.array([[600.0, 0, 200], [0, 600, 200], [0, 0, 1]])
NOTHING = np.zeros((400, 400), np.uint8)


def test_a_smaller_picture_shows_the_same_and_its_targets_are_enlarged_back():
    size_px, camera = (90, 120), Camera(np.array([[200.0, 0, 45], [0, 200, 60], [0, 0, 1]]), np.eye(4), (90, 120))
    rgb = np.repeat(np.linspace(0, 255, size_px[0]).astype(np.uint8)[None, :, None], 120, 0).repeat(3, 2)
    picture = HandPicture("one", rgb, np.full((120, 90), HAND, np.uint8), camera, HandPose.rest())
    assert made_smaller(picture, 120) is picture
    small = made_smaller(picture, 40)
    assert small.camera.size_px == (30, 40)
    point = np.array([[0.02, -0.03, 0.4]])
    larger_by = np.divide(size_px, small.camera.size_px)
    np.testing.assert_allclose(small.camera.project(point)[0] * larger_by, camera.project(point)[0])
    np.testing.assert_allclose(small.rgb[5, :, 0], rgb[5, 1::3, 0], atol=1)
    outline = OutlineTargets(np.array([3]), np.array([[1.0, 2.0]]), np.array([[0.0, 1.0]]))
    targets = PoseTargets(np.array([[4.0, 5.0]]), np.ones(1), np.eye(2)[None], outline, 1.5, 0.9).enlarged(larger_by)
    np.testing.assert_allclose(targets.px, [[12, 15]])
    np.testing.assert_allclose(targets.outline.px, [[3, 6]])
    np.testing.assert_allclose(targets.outline.normal, [[0, 1]])
    assert (targets.flow_px, targets.overlap) == (4.5, 0.9)


@pytest.fixture(scope="module")
def model():
    return middle_person()


@pytest.fixture(scope="module")
def swelling_m(model):
    """[V] 2.5 mm at the middle finger's second joint, dying out over 12 mm."""
    vertices = model.vertices(HandPose.rest())
    middle = vertices[model.hand.framed_vertices].mean(0)
    return 0.0025 * np.exp(-((vertices - middle) ** 2).sum(1) / (2 * 0.012**2))


def views_of(model, swelling_m, off_m=OFF_M):
    """Pictures of the resting hand from around it, and what their outlines want; each is off by so much."""
    pose, rng = HandPose.rest(), np.random.default_rng(0)
    vertices = model.vertices(pose)
    normals = area_weighted_normals(vertices, model.hand.f)
    swollen, middle = vertices + swelling_m[:, None] * normals, vertices[model.hand.framed_vertices].mean(0)
    pictures, targets = [], []
    for angle in 2 * np.pi * np.arange(VIEWS) / VIEWS:
        eye = middle + 0.4 * np.array([0.1, np.cos(angle), np.sin(angle)])
        camera = Camera(K, look_at(eye, middle, np.array([-1.0, 0, 0])), (400, 400))
        away = (eye - vertices) / np.linalg.norm(eye - vertices, axis=1, keepdims=True)
        vertex = np.flatnonzero(np.abs((normals * away).sum(1)) < 0.2)
        px, along_px = (camera.project(at[vertex])[0] for at in (swollen, swollen + 0.01 * normals))
        normal = (px - along_px) / np.linalg.norm(px - along_px, axis=1, keepdims=True)
        px = px + rng.normal(0, 1, 2) * off_m * K[0, 0] / 0.4
        outline = OutlineTargets(vertex, px, normal)
        pictures.append(HandPicture(str(angle), np.zeros((400, 400, 3), np.uint8), NOTHING, camera, pose))
        targets.append(PoseTargets(px, px, px, outline, 0.0, 1.0))
    return pictures, targets


def off_mm(model, found_m, true_m):
    """The mean distance over what is swollen by over half a millimetre."""
    return 1000 * np.abs(found_m - true_m)[(true_m > 0.0005) & (model.hand.arm_weights == 0)].mean()


def test_a_swelling_comes_back(model, swelling_m):
    found = outline_offsets(model, *views_of(model, swelling_m))
    assert off_mm(model, 0 * swelling_m, swelling_m) > 1.0
    assert off_mm(model, found, swelling_m) < 0.45
    assert 1000 * np.abs(found[swelling_m < 1e-6]).mean() < 0.3  # what the views' own errors leave


def test_offsets_are_found_from_those_that_there_are(model, swelling_m):
    """The second fit begins with the first one's shape, and ends where the first did."""
    pictures, targets = views_of(model, swelling_m, off_m=0.0)
    first = outline_offsets(model, pictures, targets)
    second = outline_offsets(model.with_offset(first), pictures, targets)
    assert 1000 * np.abs(second - first).max() < 0.3
    assert off_mm(model, second, swelling_m) < off_mm(model, 0 * first, swelling_m) / 3


def test_a_picture_that_is_held_out_and_the_arm_tell_nothing(model, swelling_m):
    pictures, targets = views_of(model, swelling_m)
    held_out = [replace(picture, is_held_out=True) for picture in pictures]
    np.testing.assert_array_equal(outline_offsets(model, held_out, targets), np.zeros_like(swelling_m))
    everywhere = outline_offsets(model, *views_of(model, np.full_like(swelling_m, 0.003)))
    assert 1000 * np.median(everywhere[model.hand.arm_weights == 1]) < 0.6
    assert 1000 * np.median(everywhere[model.hand.arm_weights == 0]) > 1.8


def test_offsets_have_a_bound(model, swelling_m):
    found = outline_offsets(model, *views_of(model, np.full_like(swelling_m, 0.03), off_m=0.0))
    assert np.abs(found).max() <= 0.004
