"""Rays traced by the kernels (`compute.cpu.rays.trace`) against the reference (`field.surface_tracking`)."""

import numpy as np
import pytest
import torch
from livehand.backend.compute.cpu.rays import first_hit, live_rays, rasterise_shell, trace
from livehand.backend.field.rays import CameraTensors, HandInView
from livehand.backend.field.sampler import SAMPLES_AT_SURFACE, SamplerConfig
from livehand.backend.field.surface_tracking import trace as trace_reference
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.geometry.uvh import interpolate

pytestmark = pytest.mark.slow

CONFIG = SamplerConfig(8, 0.003)
# Share of samples whose surface point may be another: on an edge rounding decides which face is found, and from there
# the walk past a crease may lead elsewhere. 4e-6 over five poses, five views and two sizes.
ELSEWHERE = 2e-4


def assert_same(mesh, topology, view, config=CONFIG, seed=None, has_signs=True, surface_depth=None):
    """Both roads' rays are the same, but for the signs of heights where there are no signs; returns them."""
    generators = (None, None) if seed is None else [torch.Generator().manual_seed(seed) for _ in range(2)]
    hand = HandInView(mesh, topology, view, surface_depth)
    ours, theirs = trace(hand, config, generators[0]), trace_reference(hand, config, generators[1])
    assert torch.equal(ours.pixel, theirs.pixel)
    assert torch.equal(ours.is_stopped, theirs.is_stopped)
    torch.testing.assert_close(ours.directions, theirs.directions)
    scale = float(mesh.scale)
    for name in ("t", "dt"):
        torch.testing.assert_close(getattr(ours, name), getattr(theirs, name), atol=1e-6 * scale, rtol=0)
    for one, other in zip(ours.samples, theirs.samples, strict=True):
        assert (one.shape, one.dtype) == (other.shape, other.dtype)
    at = [interpolate(mesh.vertices, topology, rays.samples) for rays in (ours, theirs)]
    apart = (at[0] - at[1]).norm(dim=1) > 2e-5 * scale
    heights = [rays.samples.height_m if has_signs else rays.samples.height_m.abs() for rays in (ours, theirs)]
    higher = (heights[0] - heights[1]).abs() > 1e-6
    if len(apart):
        assert apart.double().mean() < ELSEWHERE + 1.5 / len(apart)  # one sample is always allowed
        assert higher.double().mean() < ELSEWHERE + 1.5 / len(higher)
    return ours


@pytest.mark.parametrize("direction", [(0.1, -1, 0.2), (0.2, 0.3, -1), (-1, -0.5, 0.3)])
@pytest.mark.parametrize(("gesture", "side"), [("open", "right"), ("fist", "right"), ("pinch", "left")])
@pytest.mark.parametrize("seed", [None, 5])
def test_rays_and_samples_are_those_of_torch(posed, view_from, direction, gesture, side, seed):
    hand = posed(gesture, side)
    rays = assert_same(hand.mesh, hand.topology, view_from(hand.mesh, direction), seed=seed)
    assert len(rays.pixel) > 200
    assert rays.is_stopped.any()
    assert not rays.is_stopped.all()


@pytest.mark.parametrize("gesture", ["open", "fist"])
def test_rays_of_an_orthographic_camera_are_those_of_torch(posed, view_from, gesture):
    """From so near that depths in a pinhole's way would be up to 0.1 mm off."""
    hand = posed(gesture)
    view = view_from(hand.mesh, (0.2, 0.3, -1), distance=0.25)
    K = view.K.clone()
    K[:2, :2] /= 0.25
    rays = assert_same(hand.mesh, hand.topology, CameraTensors(K, view.world2cam, view.size_px, is_orthographic=True))
    assert len(rays.pixel) > 200


@pytest.mark.parametrize(("gesture", "direction"), [("open", (0.1, -1, 0.2)), ("fist", (-1, -0.5, 0.3))])
@pytest.mark.parametrize("seed", [None, 5])
def test_samples_about_a_known_surface_are_those_of_torch(posed, view_from, gesture, direction, seed):
    """Up to a millimetre before or behind the mesh; at every seventh pixel none, at every ninth elsewhere."""
    hand = posed(gesture)
    view = view_from(hand.mesh, direction)
    depth = first_hit(HandInView(hand.mesh, hand.topology, view)).depth
    depth = depth + 0.001 * torch.sin(torch.arange(len(depth)))
    depth[::7], depth[::9] = torch.inf, depth[::9] + 0.02
    rays = assert_same(hand.mesh, hand.topology, view, seed=seed, surface_depth=depth)
    assert rays.t.shape[1] == SAMPLES_AT_SURFACE == 3
    plain = assert_same(hand.mesh, hand.topology, view, seed=seed)
    assert rays.is_stopped.double().mean() > plain.is_stopped.double().mean() + 0.02
    meets = depth.isfinite()[rays.pixel]
    assert SAMPLES_AT_SURFACE * rays.dt[meets].median() < 0.7 * 8 * plain.dt[meets].median()
    torch.testing.assert_close(8 * plain.dt[~meets], SAMPLES_AT_SURFACE * rays.dt[~meets], atol=0, rtol=3e-7)


def test_the_same_generator_jitters_both_alike_and_another_otherwise(posed, view_from):
    hand = posed("relaxed")
    view = view_from(hand.mesh, (0, -1, 0))
    one, again, other = (assert_same(hand.mesh, hand.topology, view, seed=seed) for seed in (1, 1, 2))
    assert torch.equal(one.t, again.t)
    assert not torch.equal(one.t, other.t)


@pytest.mark.parametrize("layers", [1, 2, 3, 5])
def test_more_crossings_than_are_kept(posed, view_from, layers):
    hand = posed("fist")
    view = view_from(hand.mesh, (0.3, 0.8, -0.6))
    rays = assert_same(hand.mesh, hand.topology, view, SamplerConfig(6, 0.003, layers))
    all_kept = assert_same(hand.mesh, hand.topology, view, SamplerConfig(6, 0.003, 20))
    assert len(rays.pixel) == 0 or not torch.equal(rays.t, all_kept.t)  # they would not fit


@pytest.mark.parametrize("samples", [1, 3, 16])
def test_other_numbers_of_samples_and_a_thicker_shell(posed, view_from, samples):
    hand = posed("pinch")
    view = view_from(hand.mesh, (1, 0.4, 0.3))
    rays = assert_same(hand.mesh, hand.topology, view, SamplerConfig(samples, 0.005))
    assert rays.t.shape[1] == samples


@pytest.fixture(scope="module")
def scene(posed, view_from):
    hand = posed("relaxed")
    return hand.mesh, hand.topology, view_from(hand.mesh, (0.1, 1, 0.3))


def test_nothing_in_view(scene):
    mesh, topology, view = scene
    turned = torch.diag(torch.tensor([1.0, -1, -1, 1])) @ view.world2cam
    assert len(assert_same(mesh, topology, view._replace(world2cam=turned)).pixel) == 0
    beside = view.K.clone()
    beside[0, 2] += 500
    assert len(assert_same(mesh, topology, view._replace(K=beside)).pixel) == 0


@pytest.mark.parametrize("size_px", [(1, 1), (1, 50), (50, 1)])
def test_one_pixel_row_or_column(scene, size_px):
    mesh, topology, view = scene
    K = view.K.clone()
    K[:2, 2] += torch.tensor(size_px) / 2 - torch.tensor(view.size_px) / 2
    assert len(assert_same(mesh, topology, CameraTensors(K, view.world2cam, size_px)).pixel) > 0


def test_a_hand_past_the_images_border(posed, view_from):
    hand = posed("open")
    view = view_from(hand.mesh, (0.2, -1, 0.1), (41, 30), field_m=0.05)
    rays = assert_same(hand.mesh, hand.topology, view)
    column, row = rays.pixel % 41, rays.pixel // 41
    assert (int(column.min()), int(column.max()), int(row.min()), int(row.max())) == (0, 40, 0, 29)


@pytest.mark.parametrize("height_m", [0.002, 0.0, -0.002, -0.008])
def test_a_camera_within_the_shell_and_within_the_hand(posed, height_m):
    """Over the palm's middle, looking along the skin."""
    hand = posed("relaxed")
    vertex = int((hand.mesh.vertices - hand.mesh.vertices.mean(0)).norm(dim=1).argmin())
    normal = hand.mesh.normals[vertex]
    along = torch.nn.functional.normalize(torch.linalg.cross(normal, torch.tensor([0.3, 0.2, 0.9])), dim=0)
    world2cam = torch.eye(4)
    world2cam[:3, :3] = torch.stack([torch.linalg.cross(along, normal), -normal, along])
    world2cam[:3, 3] = -world2cam[:3, :3] @ (hand.mesh.vertices[vertex] + height_m * normal)
    view = CameraTensors(torch.tensor([[24.0, 0, 16], [0, 24, 15], [0, 0, 1]]), world2cam, (32, 30))
    rays = assert_same(hand.mesh, hand.topology, view)
    assert len(rays.pixel) > 0
    assert rays.t.isfinite().all()


def test_faces_without_area(posed, view_from):
    """A fingertip's vertices drawn together into one: its faces have no area, and some of its normals no length."""
    hand = posed("open")
    tip = hand.mesh.vertices[:, 0].argsort()[:40]
    vertices = hand.mesh.vertices.clone()
    vertices[tip] = vertices[tip].mean(0)
    mesh = posed_mesh(hand.topology, vertices)
    triangles = vertices[hand.topology.faces]
    area = torch.linalg.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]).norm(dim=1)
    assert int((area == 0).sum()) > 30
    for direction in ((0, -1, 0.1), (-1, 0.1, 0.2)):
        rays = assert_same(mesh, hand.topology, view_from(mesh, direction), has_signs=False)
        assert rays.samples.height_m.isfinite().all()
        assert rays.samples.barycentric.isfinite().all()


def test_a_larger_world(scene):
    mesh, topology, view = scene
    large = posed_mesh(topology, mesh.vertices * 10)
    world2cam = view.world2cam.clone()
    world2cam[:3, 3] *= 10
    one, other = assert_same(*scene), assert_same(large, topology, view._replace(world2cam=world2cam))
    shared = torch.isin(one.pixel, other.pixel), torch.isin(other.pixel, one.pixel)
    assert shared[0].double().mean() > 0.99
    torch.testing.assert_close(other.t[shared[1]], one.t[shared[0]] * 10, rtol=1e-3, atol=1e-4)


@pytest.fixture
def threads():
    """A function that sets torch's number of threads, which is put back."""
    before = torch.get_num_threads()
    yield torch.set_num_threads
    torch.set_num_threads(before)


def test_the_number_of_threads_does_not_matter(scene, threads):
    results = []
    for count in (1, 2, 3):
        threads(count)
        results.append(trace(HandInView(*scene), CONFIG, torch.Generator().manual_seed(3)))
    for other in results[1:]:
        for name in ("pixel", "t", "dt", "is_stopped"):
            assert torch.equal(getattr(results[0], name), getattr(other, name))
        for one, values in zip(results[0].samples, other.samples, strict=True):
            assert torch.equal(one, values)


def test_live_pixels_are_those_with_samples(scene):
    """More than nothing is inside."""
    mesh, topology, view = scene
    hand = HandInView(mesh, topology, view)
    crossings = rasterise_shell(hand, CONFIG)
    crossings.inner[: len(crossings.inner) // 2] = 0.01  # as if the deflated mesh were in front of everything there
    live = live_rays(crossings, hand)[0].numpy()
    assert (live >= len(crossings.inner) // 2).all()
    expected = trace_reference(HandInView(mesh, topology, view), CONFIG).pixel
    expected = expected[expected >= len(crossings.inner) // 2]
    np.testing.assert_array_equal(live, expected)
    crossed = crossings.counts > 0
    assert crossed.sum() > len(live)
