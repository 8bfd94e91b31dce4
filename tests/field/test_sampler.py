"""Samples along rays, against the closed form of rays and spheres."""

import numpy as np
import pytest
import torch
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.field.rays import HandInView, camera_tensors, ray_directions, ray_origins
from livehand.backend.field.sampler import (
    BEFORE_M,
    BEHIND_M,
    SAMPLES_AT_SURFACE,
    SamplerConfig,
    first_hit,
    sample_rays,
    shell_intervals,
)
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.records.camera import Camera, look_at

SHELL_M, RADIUS_M = 0.004, 0.05
CONFIG = SamplerConfig(samples_per_ray=8, shell_m=SHELL_M)
SIZE = (41, 37)
# A subdivided sphere lies this much within the true one.
FACET_M = 1e-4


def a_view(origin=(0.11, -0.42, 0.17), focal_px=120.0):
    K = np.array([[focal_px, 0, SIZE[0] / 2 + 0.3], [0, focal_px, SIZE[1] / 2 - 0.2], [0, 0, 1]])
    return camera_tensors(Camera(K, look_at(np.array(origin), np.zeros(3), np.array([0, 0, 1.0])), SIZE), "cpu")


def crossings(view, centre, radius):
    """Depths [P] where the ray of every pixel enters and leaves a sphere; NaN where it misses."""
    pixel = torch.arange(SIZE[0] * SIZE[1])
    directions = ray_directions(view, pixel).double()
    offset = origin_of(view) - torch.as_tensor(centre, dtype=torch.float64)
    a, b, c = (directions**2).sum(1), directions @ offset, offset @ offset - radius**2
    root = (b * b - a * c).sqrt()
    return (-b - root) / a, (-b + root) / a


def origin_of(view):
    return (-view.world2cam[:3, :3].T @ view.world2cam[:3, 3]).double()


def test_intervals_of_a_sphere_are_those_of_the_ray(spheres):
    """From r + shell to r - shell; past the inner sphere, through the outer one."""
    mesh, topology = spheres(((0, 0, 0), RADIUS_M))
    view = a_view()
    intervals = shell_intervals(HandInView(mesh, topology, view), CONFIG)
    outer_in, outer_out = crossings(view, (0, 0, 0), RADIUS_M + SHELL_M)
    inner_in, _ = crossings(view, (0, 0, 0), RADIUS_M - SHELL_M)
    expected_end = torch.where(inner_in.isnan(), outer_out, inner_in)[intervals.pixel]
    length = intervals.end - intervals.start
    assert ((length > 0).sum(1) == 1).all()
    start, end = intervals.start.double(), intervals.end.double()
    assert len(start) > 500
    first = length.argmax(1, keepdim=True)
    # At the rim a facet's height turns into a long way along the ray: compare where the ray is not grazing.
    is_clear = (outer_out - outer_in)[intervals.pixel] > 0.02
    is_clear &= ~((inner_in - outer_in)[intervals.pixel] > 0.015)
    assert int(is_clear.sum()) > 300
    torch.testing.assert_close(
        start.gather(1, first)[is_clear, 0], outer_in[intervals.pixel][is_clear], atol=4 * FACET_M, rtol=0
    )
    torch.testing.assert_close(end.gather(1, first)[is_clear, 0], expected_end[is_clear], atol=8 * FACET_M, rtol=0)


@pytest.mark.parametrize("find", [first_hit, NumbaBackend.first_hit])
@pytest.mark.parametrize("is_orthographic", [False, True])
def test_first_hits_lie_in_the_planes_of_their_faces(spheres, find, is_orthographic):
    """Which are 2 cm wide here: by the other camera's rule for depth, hits would be 0.1 mm beside them."""
    mesh, topology = spheres(((0, 0, 0), RADIUS_M), subdivisions=1)
    view = a_view(origin=(0.03, -0.12, 0.05), focal_px=400.0 if is_orthographic else 50.0)
    view = view._replace(is_orthographic=is_orthographic)
    found = find(HandInView(mesh, topology, view))
    pixel = (found.face >= 0).nonzero()[:, 0]
    points = ray_origins(view, pixel) + found.depth[pixel, None] * ray_directions(view, pixel)
    a, b, c = mesh.vertices[topology.faces[found.face[pixel].long()]].unbind(1)
    normal = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=1)
    assert len(pixel) > 500
    assert ((points - a) * normal).sum(1).abs().max() < 1e-6


def test_every_ray_of_the_outer_sphere_is_there_and_no_other(spheres):
    mesh, topology = spheres(((0, 0, 0), RADIUS_M))
    view = a_view()
    found = torch.zeros(SIZE[0] * SIZE[1], dtype=torch.bool)
    found[shell_intervals(HandInView(mesh, topology, view), CONFIG).pixel] = True
    surely, perhaps = (~crossings(view, (0, 0, 0), RADIUS_M + SHELL_M + d)[0].isnan() for d in (-FACET_M, FACET_M))
    assert (found | ~surely).all()
    assert (~found | perhaps).all()
    assert int(surely.sum()) > 500


# One behind the other as `a_view` sees them, the smaller one in front.
NEAR, FAR = ((0.033, -0.126, 0.051), 0.012), ((0.0, 0.0, 0.0), RADIUS_M)


@pytest.mark.slow
def test_no_samples_in_the_gap_between_two_surfaces(spheres):
    mesh, topology = spheres(NEAR, FAR)
    rays = sample_rays(HandInView(mesh, topology, a_view()), CONFIG)
    away = torch.stack([(rays.points - torch.tensor(c)).norm(dim=-1) - r for c, r in (NEAR, FAR)])
    assert (away.abs().amin(0) <= SHELL_M + 2 * FACET_M).all()
    assert (away[0] < 0.01).any()


@pytest.mark.slow
def test_a_grazing_ray_goes_on_to_what_lies_behind(spheres):
    """Past the small sphere's core, through its shell: the rest of the samples is on the large sphere."""
    mesh, topology = spheres(NEAR, FAR)
    view = a_view()
    rays = sample_rays(HandInView(mesh, topology, view), CONFIG)
    through_shell = ~crossings(view, NEAR[0], NEAR[1] + SHELL_M - 3 * FACET_M)[0].isnan()
    through_core = ~crossings(view, NEAR[0], NEAR[1] - SHELL_M - 3 * FACET_M)[0].isnan()
    past_core = crossings(view, NEAR[0], NEAR[1] - SHELL_M + 3 * FACET_M)[0].isnan()
    behind = ~crossings(view, FAR[0], FAR[1] - SHELL_M - 3 * FACET_M)[0].isnan()
    is_far = ((rays.points - torch.tensor(FAR[0])).norm(dim=-1) - FAR[1]).abs() < SHELL_M + 2 * FACET_M
    grazing = (through_shell & past_core & behind)[rays.pixel]
    blocked = (through_core & behind)[rays.pixel]
    assert int(grazing.sum()) > 5
    assert int(blocked.sum()) > 5
    assert (is_far[grazing].any(1) & ~is_far[grazing].all(1)).all()
    assert not is_far[blocked].any()


def test_a_ray_that_grazes_one_sphere_twice_over_nothing_is_sampled_through(spheres):
    """Through the shell but past the core: the whole chord, entry to exit."""
    mesh, topology = spheres(FAR)
    view = a_view()
    intervals = shell_intervals(HandInView(mesh, topology, view), CONFIG)
    outer_in, outer_out = crossings(view, FAR[0], RADIUS_M + SHELL_M)
    inner_in, _ = crossings(view, FAR[0], RADIUS_M - SHELL_M + 3 * FACET_M)
    grazing = (inner_in.isnan() & (outer_out - outer_in > 0.02))[intervals.pixel]
    length = (intervals.end - intervals.start).sum(1)
    assert int(grazing.sum()) > 30
    chord = (outer_out - outer_in)[intervals.pixel]
    torch.testing.assert_close(length[grazing].double(), chord[grazing], atol=2e-3, rtol=0)


def union_places(intervals, pixel, t):
    """How far along the union of its ray's intervals each sample lies, m; None where it lies outside all of them."""
    row = {p: i for i, p in enumerate(intervals.pixel.tolist())}
    positions = np.full(t.shape, np.nan)
    for r, p in enumerate(pixel.tolist()):
        before = 0.0
        for start, end in zip(intervals.start[row[p]].tolist(), intervals.end[row[p]].tolist(), strict=True):
            inside = (t[r] >= start - 1e-6) & (t[r] <= end + 1e-6) & (end > start)
            positions[r] = np.where(inside, before + t[r] - start, positions[r])
            before += end - start
    return positions


@pytest.mark.slow
def test_samples_are_equally_spaced_over_the_union_of_the_intervals(spheres):
    mesh, topology = spheres(NEAR, FAR)
    view = a_view()
    intervals = shell_intervals(HandInView(mesh, topology, view), CONFIG)
    rays = sample_rays(HandInView(mesh, topology, view), CONFIG)
    positions = union_places(intervals, rays.pixel, rays.t.numpy())
    total = (intervals.end - intervals.start).sum(1, keepdim=True).numpy()
    np.testing.assert_allclose(positions, total * (np.arange(8) + 0.5) / 8, atol=2e-6)
    np.testing.assert_allclose(rays.dt, total[:, 0] / 8, rtol=1e-5)
    assert ((intervals.end > intervals.start).sum(1) > 1).any()
    points = origin_of(view) + rays.t[..., None].double() * rays.directions[:, None].double()
    torch.testing.assert_close(rays.points.double(), points, atol=1e-6, rtol=0)


@pytest.mark.slow
def test_jitter_stays_in_its_stratum_and_is_reproducible(spheres):
    mesh, topology = spheres(NEAR, FAR)
    view = a_view()
    intervals = shell_intervals(HandInView(mesh, topology, view), CONFIG)
    one, again, other = (
        sample_rays(HandInView(mesh, topology, view), CONFIG, torch.Generator().manual_seed(seed)) for seed in (5, 5, 6)
    )
    assert torch.equal(one.t, again.t)
    assert not torch.equal(one.t, other.t)
    total = (intervals.end - intervals.start).sum(1, keepdim=True).numpy()
    stratum = union_places(intervals, one.pixel, one.t.numpy()) / total * 8 - np.arange(8)
    assert stratum.min() > -1e-3
    assert stratum.max() < 1 + 1e-3
    assert abs(stratum.mean() - 0.5) < 0.02
    assert stratum.std() == pytest.approx(12**-0.5, abs=0.01)


@pytest.mark.slow
def test_a_larger_world_has_a_larger_shell(spheres):
    mesh, topology = spheres(((0, 0, 0), RADIUS_M))
    view = a_view()
    large = posed_mesh(topology, mesh.vertices * 10)
    far_away = view._replace(world2cam=torch.cat([view.world2cam[:, :3], view.world2cam[:, 3:] * 10], 1))
    far_away.world2cam[3, 3] = 1
    one = sample_rays(HandInView(mesh, topology, view), CONFIG)
    other = sample_rays(HandInView(large, topology, far_away), CONFIG)
    shared = torch.isin(one.pixel, other.pixel), torch.isin(other.pixel, one.pixel)
    assert shared[0].double().mean() > 0.99
    torch.testing.assert_close(other.t[shared[1]], one.t[shared[0]] * 10, rtol=1e-3, atol=1e-4)


@pytest.mark.slow
def test_layers_beyond_those_kept_do_not_disturb_the_first(spheres):
    positions = [((0.0, 0.06 * k, 0.0), 0.02) for k in range(5)]
    mesh, topology = spheres(*positions)
    view = a_view(origin=(0.01, -0.42, 0.012))
    few = shell_intervals(HandInView(mesh, topology, view), SamplerConfig(shell_m=0.004, max_layers=2))
    many = shell_intervals(HandInView(mesh, topology, view), SamplerConfig(shell_m=0.004, max_layers=20))
    assert torch.equal(few.pixel, many.pixel)
    first = [torch.where(i.end > i.start, i.start, torch.inf).amin(1) for i in (few, many)]
    torch.testing.assert_close(*first)
    assert ((many.end > many.start).sum(1) > 1).any()


def test_the_camera_within_the_shell_is_no_error(spheres):
    mesh, topology = spheres(((0, 0, 0), RADIUS_M))
    rays = sample_rays(HandInView(mesh, topology, a_view(origin=(0.0, -RADIUS_M - 0.002, 0.0))), CONFIG)
    assert rays.t.isfinite().all()
    assert rays.points.isfinite().all()


def known(mesh, topology, view, depth):
    """The spheres in a view, with a known surface at a depth [P]."""
    return HandInView(mesh, topology, view, depth.float())


@pytest.mark.slow
def test_rays_that_meet_a_known_surface_are_sampled_about_it_and_end_there(spheres):
    """A surface half a millimetre within the large sphere; the small one, before it, stays as it is."""
    mesh, topology = spheres(NEAR, FAR)
    view = a_view()
    depth = crossings(view, FAR[0], RADIUS_M - 0.0005)[0].nan_to_num(torch.inf)
    small = ~crossings(view, NEAR[0], NEAR[1] + SHELL_M + FACET_M)[0].isnan()
    plain, about = (
        shell_intervals(hand, CONFIG) for hand in (HandInView(mesh, topology, view), known(mesh, topology, view, depth))
    )
    assert torch.equal(plain.pixel, about.pixel)
    length = [(intervals.end - intervals.start).sum(1) for intervals in (plain, about)]
    entry, grazes = (
        crossings(view, FAR[0], RADIUS_M + SHELL_M)[0],
        crossings(view, FAR[0], RADIUS_M - SHELL_M)[0].isnan(),
    )
    # Far enough from the rims that the shell holds all of the reach.
    clear = (depth.isfinite() & ~grazes & ~small & (depth - entry > BEFORE_M + 1e-3))[plain.pixel]
    inner = crossings(view, FAR[0], RADIUS_M - SHELL_M)[0][plain.pixel]
    expected = torch.minimum(torch.tensor(BEFORE_M + BEHIND_M), inner - depth[plain.pixel] + BEFORE_M)
    assert int(clear.sum()) > 200
    torch.testing.assert_close(length[1][clear].double(), expected[clear].double(), atol=8 * FACET_M, rtol=0)
    assert about.is_stopped[clear].all()
    first = torch.where(about.end > about.start, about.start, torch.inf).amin(1)
    torch.testing.assert_close(first[clear].double(), depth[plain.pixel][clear] - BEFORE_M, atol=1e-6, rtol=0)
    assert torch.equal(length[0][~depth.isfinite()[plain.pixel]], length[1][~depth.isfinite()[plain.pixel]])
    assert torch.equal(about.since, plain.since)


@pytest.mark.slow
def test_a_known_surface_takes_few_samples_which_skip_what_lies_before_it(spheres):
    """Past the small sphere's rim, the large one is seen: no sample lies on the small one."""
    mesh, topology = spheres(NEAR, FAR)
    view = a_view()
    depth = crossings(view, FAR[0], RADIUS_M)[0].nan_to_num(torch.inf)
    rays = sample_rays(known(mesh, topology, view, depth), CONFIG)
    assert rays.t.shape[1] == SAMPLES_AT_SURFACE == 3
    past_core = crossings(view, NEAR[0], NEAR[1] - SHELL_M + 3 * FACET_M)[0].isnan()
    meets = (depth.isfinite() & past_core)[rays.pixel]
    gap = rays.t - depth[rays.pixel, None]
    within = (gap > -BEFORE_M - 1e-6) & (gap < BEHIND_M + 1e-6)
    assert within[meets].double().mean() > 0.99  # beside the rim, facets may have no shell there
    on_small = ((rays.points - torch.tensor(NEAR[0])).norm(dim=-1) - NEAR[1]).abs() < SHELL_M
    assert not (on_small & meets[:, None]).any()
    plain = sample_rays(HandInView(mesh, topology, view), CONFIG)
    assert ((plain.points - torch.tensor(NEAR[0])).norm(dim=-1) - NEAR[1] < SHELL_M)[meets].any()
    assert rays.is_open[meets].any(2).all()
    few = SamplerConfig(samples_per_ray=2, shell_m=SHELL_M)
    assert sample_rays(known(mesh, topology, view, depth), few).t.shape[1] == 2


@pytest.mark.slow
@pytest.mark.parametrize("beside_m", [-0.05, 0.2])
def test_a_known_surface_outside_the_shell_changes_no_interval(spheres, beside_m):
    mesh, topology = spheres(FAR)
    view = a_view()
    depth = crossings(view, FAR[0], RADIUS_M)[0].nan_to_num(torch.inf) + beside_m
    plain, other = (
        shell_intervals(hand, CONFIG) for hand in (HandInView(mesh, topology, view), known(mesh, topology, view, depth))
    )
    for name in ("pixel", "start", "end", "is_stopped"):
        assert torch.equal(getattr(plain, name), getattr(other, name))


def test_a_ray_is_stopped_by_the_deflated_mesh_only(spheres):
    """Not where it grazes the shell."""
    mesh, topology = spheres(((0, 0, 0), RADIUS_M))
    view = a_view()
    rays = sample_rays(HandInView(mesh, topology, view), CONFIG)
    surely = ~crossings(view, (0, 0, 0), RADIUS_M - SHELL_M - 3 * FACET_M)[0].isnan()[rays.pixel]
    never = crossings(view, (0, 0, 0), RADIUS_M - SHELL_M + 3 * FACET_M)[0].isnan()[rays.pixel]
    assert rays.is_stopped[surely].all()
    assert not rays.is_stopped[never].any()
    assert int(surely.sum()) > 300
    assert int(never.sum()) > 50


@pytest.mark.slow
def test_crossings_are_those_of_the_inflated_fronts(spheres):
    """Nearest first, on the sphere that the ray meets there; where there is no more, infinitely far."""
    mesh, topology = spheres(NEAR, FAR)
    view = a_view()
    intervals = shell_intervals(HandInView(mesh, topology, view), CONFIG)
    depth = torch.stack([crossings(view, c, r + SHELL_M)[0] for c, r in (NEAR, FAR)], 1).nan_to_num(torch.inf)
    expected, order = depth[intervals.pixel].sort(1)
    found = intervals.entry.sort(1).values[:, :2].double()  # backs lie between, infinitely far as well
    grazing = [crossings(view, c, r + SHELL_M - 3 * FACET_M)[0].isnan() for c, r in (NEAR, FAR)]
    clear = (torch.stack(grazing, 1) == depth.isinf()).all(1)[intervals.pixel]
    assert int(clear.sum()) > 300
    assert (found.isfinite() == expected.isfinite())[clear].all()
    both = clear[:, None] & expected.isfinite()
    assert (found - expected)[both].abs().median() < FACET_M
    front = intervals.entry_face.gather(1, intervals.entry.argsort(1)[:, :2])
    is_far = (front >= len(topology.faces) // 2).long()
    assert torch.equal(is_far[both], order[both])
    assert ((expected.isfinite().sum(1) == 2) & clear).sum() > 20


def test_of_two_spheres_apart_the_one_that_holds_the_sample_is_open(spheres):
    mesh, topology = spheres(NEAR, FAR)
    rays = sample_rays(HandInView(mesh, topology, a_view()), CONFIG)
    assert (rays.is_open.sum(2) == 1).all()
    face = rays.entry_face[:, None].expand(-1, 8, -1)[rays.is_open].reshape(-1, 8)
    away = torch.stack([(rays.points - torch.tensor(c)).norm(dim=-1) - r for c, r in (NEAR, FAR)]).abs()
    assert torch.equal(face < len(topology.faces) // 2, away[0] < away[1])


def test_of_two_spheres_whose_shells_overlap_both_are_open_behind_the_second_front(spheres):
    """Where the first is left before the second is entered, that ends it: they are two intervals."""
    direction, radius_m = np.array(NEAR[0]) / np.linalg.norm(NEAR[0]), NEAR[1]
    close = (tuple((RADIUS_M + radius_m + 0.001) * direction), radius_m)
    mesh, topology = spheres(close, FAR)
    view = a_view()
    rays = sample_rays(HandInView(mesh, topology, view), CONFIG)
    ends = [crossings(view, centre, radius + SHELL_M) for centre, radius in (close, FAR)]
    entry = torch.stack([of_one[0] for of_one in ends], 1)[rays.pixel].nan_to_num(torch.inf)
    overlap = (ends[0][1] - ends[1][0])[rays.pixel].nan_to_num(torch.inf)  # alone: as if they did
    behind = rays.t[:, :, None] > entry[:, None]
    expected = torch.where(overlap[:, None] > 0, behind.sum(2), 1)
    clear = (overlap.abs() > 20 * FACET_M)[:, None] & ((rays.t[..., None] - entry[:, None]).abs() > 8 * FACET_M).all(2)
    assert torch.equal(rays.is_open.sum(2)[clear], expected[clear])
    assert int((expected[clear] == 2).sum()) > 20
    assert int((clear & (overlap[:, None] < 0)).sum()) > 20


def test_every_sample_lies_behind_a_crossing(posed, view_from):
    for gesture in ("open", "fist"):
        hand = posed(gesture)
        rays = sample_rays(HandInView(hand.mesh, hand.topology, view_from(hand.mesh, (0.2, -1, 0.3))), CONFIG)
        assert rays.is_open.any(2).all()
