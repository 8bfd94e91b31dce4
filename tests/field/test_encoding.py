"""Positional encoding and feature planes, by value."""

import itertools

import numpy as np
import pytest
import torch
from livehand.backend.compute.cpu.gradients import read_plane
from livehand.backend.field.encoding import FeaturePlane, positional_encoding
from scipy.ndimage import map_coordinates


@pytest.mark.slow
def test_positional_encoding_is_the_papers():
    """x, then sin and cos of x, 2x, 4x, ..., without a factor pi."""
    x = torch.tensor([[0.3, -1.2, 0.7]], dtype=torch.float64)
    expected = [x]
    for octave in range(4):
        expected += [torch.sin(2**octave * x), torch.cos(2**octave * x)]
    torch.testing.assert_close(positional_encoding(x, 4), torch.cat(expected, -1))


@pytest.mark.parametrize(("octaves", "size"), [(10, 63), (4, 27), (0, 3)])
def test_sizes_are_the_papers(octaves, size):
    assert positional_encoding(torch.zeros(2, 5, 3), octaves).shape == (2, 5, size)


@pytest.mark.parametrize("x", [0.0, 1e-30, 1e4, -1e4])
def test_encoding_gradients_are_finite(x):
    x = torch.full((1, 3), x, requires_grad=True)
    positional_encoding(x, 10).sum().backward()
    assert x.grad.isfinite().all()


@pytest.fixture
def plane():
    torch.manual_seed(0)
    return FeaturePlane(8, 3, 2).double()


def by_torch(plane, uv, height):
    return plane(uv, height, torch.ones(len(uv)))


def by_kernels(plane, uv, height):
    return read_plane(plane, uv, height, torch.ones(len(uv), dtype=uv.dtype))


@pytest.fixture(params=[by_torch, by_kernels])
def read(request):
    return request.param


def at(plane, row, column, layer):
    return plane.table[(row * plane.resolution + column) * plane.heights + layer]


def test_texel_centres_give_the_table_back(plane, read):
    for row, column, layer in itertools.product(range(8), range(8), range(3)):
        uv = torch.tensor([[(column + 0.5) / 8, (row + 0.5) / 8]], dtype=torch.float64)
        height = torch.tensor([layer - 1.0], dtype=torch.float64)
        torch.testing.assert_close(read(plane, uv, height)[0], at(plane, row, column, layer))


def test_between_texels_it_is_trilinear(plane, read):
    rng = np.random.default_rng(0)
    uv, height = rng.uniform(-0.05, 1.05, (200, 2)), rng.uniform(-1.2, 1.2, 200)
    volume = plane.table.detach().reshape(8, 8, 3, 2).numpy()
    points = [uv[:, 1] * 8 - 0.5, uv[:, 0] * 8 - 0.5, height.clip(-1, 1) + 1]
    points = [np.clip(place, 0, limit) for place, limit in zip(points, (7, 7, 2), strict=True)]
    expected = np.stack([map_coordinates(volume[..., c], points, order=1) for c in range(2)], 1)
    np.testing.assert_allclose(read(plane, torch.as_tensor(uv), torch.as_tensor(height)).detach(), expected, atol=1e-12)


def test_a_plane_of_one_height_ignores_it(read):
    plane = FeaturePlane(4, 1, 3)
    uv = torch.rand(6, 2)
    assert torch.equal(read(plane, uv, torch.full((6,), -1.0)), read(plane, uv, torch.full((6,), 0.7)))


def test_plane_gradients_are_right(plane, read):
    uv = torch.tensor([[0.31, 0.77], [0.52, 0.13]], dtype=torch.float64, requires_grad=True)
    height = torch.tensor([0.3, -0.6], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda *place: read(plane, *place), (uv, height))
    read(plane, uv, height).sum().backward()
    touched = plane.table.grad.abs().sum(1) > 0
    assert int(touched.sum()) == 2 * 8  # four texels, two layers, each point
    assert float(plane.table.grad.sum()) == pytest.approx(2 * 2)  # weights sum to one


@pytest.mark.parametrize("uv", [-10.0, 0.0, 1.0, 10.0])
@pytest.mark.parametrize("height", [-1e6, -1.0, 1.0, 1e6])
def test_beyond_the_plane_its_border_holds(plane, read, uv, height):
    place, height = torch.full((1, 2), uv, dtype=torch.float64), torch.tensor([height], dtype=torch.float64)
    edge = 7 if uv > 0.5 else 0
    torch.testing.assert_close(read(plane, place, height)[0], at(plane, edge, edge, 2 if height > 0 else 0))
