"""Points laid on a moving surface: where tracing lays them, where an exact search does, and their derivatives."""

import pytest
import torch
from livehand.backend.field.rays import HandInView, ray_origin
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.field.surface_tracking import trace
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.geometry.reprojection import reproject
from livehand.backend.geometry.uvh import interpolate


@pytest.fixture(scope="module")
def traced(posed, view_from):
    """The open hand's samples: topology, mesh, points [S, 3], samples."""
    hand = posed("open")
    view = view_from(hand.mesh, [0.2, 1, 0.3])
    rays = trace(HandInView(hand.mesh, hand.topology, view), SamplerConfig(), torch.Generator().manual_seed(0))
    points = (ray_origin(view) + rays.t[..., None] * rays.directions[:, None]).flatten(0, 1)
    return hand.topology, hand.mesh, points, rays.samples


@pytest.mark.slow
def test_an_unmoved_surface_gives_what_tracing_gave(traced):
    topology, mesh, points, samples = traced
    ours = reproject(points, samples.face, topology, mesh)
    assert torch.equal(ours.face, samples.face)
    assert (ours.height_m - samples.height_m).abs().max() < 2e-6
    apart = interpolate(mesh.vertices, topology, ours) - interpolate(mesh.vertices, topology, samples)
    assert apart.norm(dim=-1).max() < 5e-6
    assert (samples.height_m < -1e-3).any()
    assert (samples.height_m > 1e-3).any()


def test_a_scaled_scene_has_the_same_heights(traced):
    """Heights count in the template's metres."""
    topology, mesh, points, samples = traced
    large = posed_mesh(topology, mesh.vertices * 3)
    ours = reproject(points * 3, samples.face, topology, large)
    torch.testing.assert_close(ours.height_m, samples.height_m, atol=3e-6, rtol=1e-3)


@pytest.mark.slow
def test_after_a_small_movement_the_points_lie_where_an_exact_search_lays_them(traced, nearest_face):
    topology, mesh, points, samples = traced
    generator = torch.Generator().manual_seed(1)
    some = torch.randperm(len(points), generator=generator)[:400]
    bend = 0.0003 * torch.sin(40 * mesh.vertices[:, [1, 2, 0]])  # by up to a third of a millimetre
    moved = posed_mesh(topology, mesh.vertices + bend)
    ours = reproject(points[some], samples.face[some], topology, moved)
    face, distance = nearest_face(points[some], moved.vertices[topology.faces])
    error = (ours.height_m.abs() * moved.scale - distance).abs()
    assert error.quantile(0.9) < 1e-5
    before = (samples.height_m[some].abs() * mesh.scale - distance).abs()
    assert error.mean() < 0.1 * before.mean()  # at contacts another part may be nearer: those stay on their own
    assert (face == samples.face[some]).double().mean() > 0.8


def test_the_derivatives_are_finite_differences(traced):
    """Of places on the faces and heights, along a random movement of the vertices, in double precision."""
    topology, mesh, points, samples = traced
    generator = torch.Generator().manual_seed(2)
    some = torch.randperm(len(points), generator=generator)[:600]
    points, face = points[some].double(), samples.face[some]
    vertices = mesh.vertices.double()
    along = 1e-3 * torch.randn(vertices.shape, generator=generator).double()

    def laid(step):
        ours = reproject(points, face, topology, posed_mesh(topology, vertices + step * along))
        return torch.cat([ours.barycentric, 1000 * ours.height_m[:, None]], 1)

    size = 1e-5
    below, here, above = (laid(torch.tensor(step, dtype=torch.float64)) for step in (-size, 0.0, size))
    difference = (above - below) / (2 * size)
    is_smooth = (above + below - 2 * here).abs().amax(1) < 1e-2 * size  # few pass from an edge to a corner
    assert is_smooth.double().mean() > 0.98
    assert difference[:, :3].abs().mean() > 0.1
    assert difference[:, 3].abs().mean() > 0.3
    for _ in range(4):
        weights = torch.randn(difference.shape, generator=generator).double() * is_smooth[:, None]
        step = torch.zeros((), dtype=torch.float64, requires_grad=True)
        (slope,) = torch.autograd.grad((weights * laid(step)).sum(), step)
        assert float(slope) == pytest.approx(float((weights * difference).sum()), rel=1e-3)


@pytest.mark.slow
def test_a_surface_moved_along_its_normal_lowers_the_points(spheres):
    mesh, topology = spheres(((0.0, 0, 0), 0.05))
    vertices = mesh.vertices.clone().requires_grad_()
    middle = mesh.vertices[topology.faces].mean(1)
    face = torch.arange(0, len(middle), 7)
    for height in (0.002, 0.0, -0.002):
        points = middle[face] * (1 + height / middle[face].norm(dim=-1, keepdim=True))
        ours = reproject(points, face, topology, posed_mesh(topology, vertices))
        torch.testing.assert_close(ours.height_m, torch.full((len(face),), height), atol=2e-6, rtol=0)
        (gradient,) = torch.autograd.grad(ours.height_m.sum(), vertices)
        assert gradient.isfinite().all()
        shift = torch.tensor([0.3, -0.2, 0.5])
        expected = -(torch.nn.functional.normalize(middle[face], dim=-1) @ shift).sum()  # no change of scale in a shift
        assert float((gradient @ shift).sum()) == pytest.approx(float(expected), abs=0.02)
