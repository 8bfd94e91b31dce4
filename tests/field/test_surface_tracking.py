"""Samples on the part of the surface that their ray entered: against a search of all faces, and where parts overlap."""

import numpy as np
import pytest
import torch
from livehand.backend.field.rays import HandInView
from livehand.backend.field.sampler import SamplerConfig, sample_rays
from livehand.backend.field.surface_tracking import track
from livehand.backend.geometry.mesh import PosedMesh
from livehand.backend.geometry.torch_rotation import axis_angle_to_matrix
from livehand.backend.geometry.uvh import interpolate

pytestmark = pytest.mark.slow

SHELL_M = 0.003
CONFIG = SamplerConfig(8, SHELL_M)
SIDES = ((0, -1, 0.1), (0, 1, 0.2), (-0.3, 0.2, 1), (-1, -0.5, 0.3), (0.2, 0.3, -1))


@pytest.fixture(scope="module")
def posed(posed_without_arm):
    """Without an arm, whose samples would outnumber those where skin lies on skin."""
    return posed_without_arm


@pytest.fixture(scope="module")
def tracked(posed, view_from, nearest_face):
    """A function gesture -> (rays, samples, distance [S] to the nearest of all faces), from five sides, jittered."""

    def look(gesture):
        hand = posed(gesture)
        triangles = hand.mesh.vertices[hand.topology.faces]
        seen = []
        for seed, side in enumerate(SIDES):
            view = view_from(hand.mesh, side)
            generator = torch.Generator().manual_seed(seed)
            rays = sample_rays(HandInView(hand.mesh, hand.topology, view), CONFIG, generator)
            rays = type(rays)(*(values[::2] for values in rays))
            samples = track(rays.points, rays.entry_face, rays.is_open, hand.topology, hand.mesh)
            seen.append((rays, samples, nearest_face(rays.points.flatten(0, 1), triangles)[1]))
        rays, samples, distance = zip(*seen, strict=True)
        return concatenated(rays), concatenated(samples), torch.cat(distance)

    return look


def concatenated(parts):
    return type(parts[0])(*(torch.cat(values) for values in zip(*parts, strict=True)))


def excess_of(rays, samples, distance):
    """By how much the tracked point is farther than the nearest one, m, and whether a single part is near, [S]."""
    excess = samples.height_m.abs().double() - distance
    # At the rim of another part's shell a ray may be near it, yet not have crossed the inflated mesh.
    is_one = (rays.is_open.sum(2).flatten() == 1) & (distance < 0.9 * SHELL_M)
    return excess, is_one


@pytest.mark.parametrize("gesture", ["rest", "open"])
def test_where_one_part_is_near_it_is_the_closest_point_of_all(tracked, posed, gesture):
    """But for a few of the rays that look along a finger, whose samples lie five faces apart and more."""
    rays, samples, distance = tracked(gesture)
    excess, is_one = excess_of(rays, samples, distance)
    assert len(excess) > 5000
    assert is_one.double().mean() > 0.85
    is_short = (rays.dt < 0.01).repeat_interleave(CONFIG.samples_per_ray)
    assert is_short.double().mean() > 0.85
    assert excess[is_one & is_short].abs().max() < 1e-6
    assert (excess[is_one] > 1e-6).double().mean() < 3e-4
    hand = posed(gesture)
    at = interpolate(hand.mesh.vertices, hand.topology, samples)
    torch.testing.assert_close((at - rays.points.flatten(0, 1)).norm(dim=1), samples.height_m.abs(), atol=1e-6, rtol=0)
    # Fingers' far sides and the atlas' seams are among them.
    normal = interpolate(hand.mesh.normals, hand.topology, samples)
    leaves = (normal * rays.directions.repeat_interleave(CONFIG.samples_per_ray, 0)).sum(1) > 0.3
    assert int((leaves & is_one).sum()) > 250
    assert int((on_seam(hand.topology)[samples.face] & is_one).sum()) > 250


def on_seam(topology):
    """[F] whether a corner of the face has several places in the atlas."""
    vertex, uv = topology.faces.flatten(), topology.corner_uv.flatten(0, 1)
    lowest = uv.new_full((int(vertex.max()) + 1, 2), 9.0).scatter_reduce(0, vertex[:, None].expand(-1, 2), uv, "amin")
    highest = torch.zeros_like(lowest).scatter_reduce(0, vertex[:, None].expand(-1, 2), uv, "amax")
    return ((highest - lowest).amax(1) > 1e-6)[topology.faces].any(1)


@pytest.mark.parametrize(("gesture", "least", "most"), [("Palmar Pinch", 5e-4, 0.006), ("fist", 2e-3, 0.015)])
def test_where_skin_lies_on_skin_few_samples_differ_and_by_intent(tracked, gesture, least, most):
    """More than 0.1 mm: 0.13 % of a pinch's samples, in which pads touch, and 0.7 % of a fist's.

    Nearly all of them lie deeper in the part that owns them than under the nearest skin; the others, 0.05 % of all,
    were followed past a crease, where the nearest point jumps and walking does not.
    """
    rays, samples, distance = tracked(gesture)
    excess, is_one = excess_of(rays, samples, distance)
    assert excess.min() > -1e-6
    differs = excess > 1e-4
    assert least <= differs.double().mean() < most
    assert (differs & is_one).double().mean() < 2e-4
    assert (differs & (samples.height_m > 0)).double().mean() < 1e-3
    assert excess.max() < 0.02


A, B, OVERLAP_M = (0.0, 0.0, 0.0), (0.039, 0.0, 0.0), 0.001
RADIUS_M = 0.02


def test_a_sample_in_two_parts_belongs_to_the_one_that_holds_it_deepest(spheres, view_from, nearest_face, backend):
    """Two spheres that overlap by 1 mm. Nearest is the skin that is about to end; deepest is the other's inside."""
    mesh, topology = spheres((A, RADIUS_M), (B, RADIUS_M))
    view = view_from(mesh, (0.02, -1, 0.03), (96, 80), field_m=0.06)
    rays = backend.trace(HandInView(mesh, topology, view), SamplerConfig(16, SHELL_M))
    origin = -view.world2cam[:3, :3].T @ view.world2cam[:3, 3]
    points = (origin + rays.t[..., None] * rays.directions[:, None]).flatten(0, 1)
    height = torch.stack([(points - torch.tensor(centre)).norm(dim=1) - RADIUS_M for centre in (A, B)])
    owner = (rays.samples.face >= len(topology.faces) // 2).long()
    deepest, nearest = height.argmin(0), height.abs().argmin(0)
    facet_m = 3e-5  # a subdivided sphere lies this much within the true one
    contested = (height < SHELL_M).all(0) & ((height[0] - height[1]).abs() > 2 * facet_m)
    assert int(contested.sum()) > 300
    assert torch.equal(owner[contested], deepest[contested])
    by_intent = contested & (deepest != nearest) & ((height[0].abs() - height[1].abs()).abs() > 2 * facet_m)
    assert int(by_intent.sum()) > 50
    searched = nearest_face(points[by_intent], mesh.vertices[topology.faces])[0] >= len(topology.faces) // 2
    assert (searched.long() != owner[by_intent]).all()
    torch.testing.assert_close(rays.samples.height_m[contested], height.amin(0)[contested], atol=facet_m, rtol=0)


def test_inside_one_and_outside_the_other_it_is_the_one_it_is_inside(spheres):
    """By hand: 1.1 mm inside A, 0.1 mm outside B, whose skin is nearer."""
    mesh, topology = spheres((A, RADIUS_M), (B, RADIUS_M))
    half = len(topology.faces) // 2
    point = torch.tensor([[[0.0189, 0.0, 0.0]]])
    centre = mesh.vertices[topology.faces].mean(1)
    entry = torch.stack(
        [(centre[:half] - point[0]).norm(dim=1).argmin(), (centre[half:] - point[0]).norm(dim=1).argmin()]
    )
    entry = entry + torch.tensor([0, half])
    both = track(point, entry[None], torch.tensor([[[True, True]]]), topology, mesh)
    only_b = track(point, entry[None], torch.tensor([[[False, True]]]), topology, mesh)
    assert int(both.face) < half <= int(only_b.face)
    assert float(both.height_m) == pytest.approx(-0.0011, abs=3e-5)
    assert float(only_b.height_m) == pytest.approx(0.0001, abs=3e-5)


@pytest.fixture(scope="module")
def pinched(posed, view_from):
    hand = posed("pinch")
    return hand, sample_rays(HandInView(hand.mesh, hand.topology, view_from(hand.mesh, SIDES[2])), CONFIG)


def test_a_rigid_motion_changes_nothing(pinched):
    hand, rays = pinched
    turn = axis_angle_to_matrix(torch.tensor([0.7, -0.4, 1.1]))
    moved = PosedMesh(hand.mesh.vertices @ turn.T + 0.3, hand.mesh.normals @ turn.T, hand.mesh.scale)
    here = track(rays.points, rays.entry_face, rays.is_open, hand.topology, hand.mesh)
    there = track(rays.points @ turn.T + 0.3, rays.entry_face, rays.is_open, hand.topology, moved)
    away = (here.height_m - there.height_m).abs()
    assert (away > 1e-6).double().mean() < 2e-3  # on a shared edge either face may be found, and lead on
    back = (interpolate(moved.vertices, hand.topology, there) - 0.3) @ turn
    apart = (interpolate(hand.mesh.vertices, hand.topology, here) - back).norm(dim=1)
    assert (apart > 1e-5).double().mean() < 5e-3
    assert here.height_m.std() > 1e-3


def test_rays_and_their_crossings_may_come_in_any_order(pinched):
    hand, rays = pinched
    generator = torch.Generator().manual_seed(0)
    order, crossing = (torch.randperm(n, generator=generator) for n in rays.entry_face.shape)
    here = track(rays.points, rays.entry_face, rays.is_open, hand.topology, hand.mesh)
    face, is_open = rays.entry_face[order][:, crossing], rays.is_open[order][:, :, crossing]
    there = track(rays.points[order], face, is_open, hand.topology, hand.mesh)
    for one, other in zip(here, there, strict=True):
        assert torch.equal(one.unflatten(0, rays.points.shape[:2])[order], other.unflatten(0, rays.points.shape[:2]))


def test_what_is_not_open_is_not_looked_at(pinched):
    hand, rays = pinched
    here = track(rays.points, rays.entry_face, rays.is_open, hand.topology, hand.mesh)
    is_ever = rays.is_open.any(1)
    nonsense = torch.where(is_ever, rays.entry_face, 7)
    for one, other in zip(here, track(rays.points, nonsense, rays.is_open, hand.topology, hand.mesh), strict=True):
        assert torch.equal(one, other)


def test_no_rays(pinched):
    hand, rays = pinched
    none = track(rays.points[:0], rays.entry_face[:0], rays.is_open[:0], hand.topology, hand.mesh)
    assert [tuple(values.shape) for values in none] == [(0,), (0, 3), (0,)]


def test_a_larger_world_has_larger_heights(pinched):
    hand, rays = pinched
    large = PosedMesh(hand.mesh.vertices * 8, hand.mesh.normals, hand.mesh.scale * 8)
    here = track(rays.points, rays.entry_face, rays.is_open, hand.topology, hand.mesh)
    there = track(rays.points * 8, rays.entry_face, rays.is_open, hand.topology, large)
    torch.testing.assert_close(there.height_m, here.height_m * 8)
    assert np.array_equal(there.face, here.face)
