"""Reading planes in the kernels against `field.encoding.FeaturePlane`, and the gradients against torch's."""

import itertools
from functools import partial

import numba
import numpy as np
import pytest
import torch
from livehand.backend.compute.cpu.gradients import read_plane as read_by_kernels
from livehand.backend.compute.kernels.field import BLOCK, read_plane
from livehand.backend.compute.kernels.gradients import table_gradient
from livehand.backend.field.encoding import FeaturePlane

GUARD = 77.0


@numba.njit
def call_read_plane(table, start, sizes, u, v, h, fade, out, at):
    """Only kernels can call parts of kernels."""
    read_plane(table, start, sizes[0], sizes[1], sizes[2], u, v, h, fade, out, at)


def read(plane, uv, height, fade=1.0, start=0, at=0):
    """[S, channels] by the kernel, from a table that begins at `start` of an array, written from `at` on."""
    table = np.concatenate([np.full(start, 1e9), plane.table.detach().numpy().ravel()]).astype(np.float32)
    sizes = plane.resolution, plane.heights, plane.channels
    rows = []
    for (u, v), h in zip(uv.numpy(), height.numpy(), strict=True):
        out = np.full(at + plane.channels + 2, GUARD, np.float32)
        call_read_plane(table, start, sizes, u, v, h, np.float32(fade), out, at)
        assert (out[:at] == GUARD).all()
        assert (out[at + plane.channels :] == GUARD).all()
        rows.append(out[at : at + plane.channels])
    return torch.as_tensor(np.stack(rows))


def a_plane(resolution, heights, channels):
    torch.manual_seed(resolution + heights)
    return FeaturePlane(resolution, heights, channels, init=1.0)


def hit_points(count, seed=0):
    generator = torch.Generator().manual_seed(seed)
    uv = torch.rand(count, 2, generator=generator)
    height = torch.rand(count, generator=generator) * 2.4 - 1.2
    return uv, height


@pytest.mark.parametrize(("resolution", "heights"), [(2, 1), (2, 2), (7, 1), (16, 3), (64, 6)])
@pytest.mark.parametrize("blocks", [1, 2, 3])
def test_anywhere(resolution, heights, blocks):
    plane = a_plane(resolution, heights, blocks * BLOCK)
    uv, height = hit_points(80)
    torch.testing.assert_close(
        read(plane, uv, height), plane(uv, height, torch.ones(len(uv))).detach(), atol=1e-5, rtol=1e-5
    )


@pytest.mark.parametrize("heights", [1, 2, 3])
def test_on_the_atlas_border_on_texels_and_beyond_the_shell(heights):
    """u and v at 0, at 1, on texel centres; heights on the layers, at the ends and past them."""
    plane = a_plane(8, heights, BLOCK)
    ends = torch.tensor([0.0, 1.0, 0.5 / 8, 7.5 / 8, 3.5 / 8, 4.0 / 8, -0.01, 1.01])
    u, v, height = torch.meshgrid(ends, ends, torch.tensor([-9.0, -1.0, -0.5, 0.0, 0.3, 1.0, 9.0]), indexing="ij")
    uv, height = torch.stack([u.flatten(), v.flatten()], -1), height.flatten()
    torch.testing.assert_close(
        read(plane, uv, height), plane(uv, height, torch.ones(len(uv))).detach(), atol=1e-5, rtol=1e-5
    )


def test_a_texels_centre_is_that_texel():
    plane = a_plane(4, 3, BLOCK)
    uv = torch.tensor([[2.5 / 4, 1.5 / 4]])
    for layer, height in enumerate((-1.0, 0.0, 1.0)):
        expected = plane.table.detach()[((1 * 4 + 2) * 3 + layer)]
        torch.testing.assert_close(read(plane, uv, torch.tensor([height]))[0], expected)


def test_fading_place_in_the_table_and_place_in_the_output():
    plane = a_plane(16, 3, 2 * BLOCK)
    uv, height = hit_points(20, seed=3)
    expected = plane(uv, height, torch.ones(len(uv))).detach()
    torch.testing.assert_close(read(plane, uv, height, fade=0.25), expected * 0.25, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(read(plane, uv, height, start=40, at=5), expected, atol=1e-5, rtol=1e-5)


PLANES = [(2, 1, 3), (2, 2, 1), (7, 1, 4), (16, 3, 8), (9, 6, 7)]


def gradients(plane, read, uv, height, fade, seed=0):
    """(features, gradients of table, uv, height and fade) for a random gradient of the features."""
    inputs = [values.clone().requires_grad_() for values in (uv, height, fade)]
    features = read(*inputs)
    outward = torch.randn(features.shape, generator=torch.Generator().manual_seed(seed), dtype=features.dtype)
    needed = [plane.table, *inputs]  # a plane of one layer has no use for the height
    found = torch.autograd.grad(features, needed, outward, allow_unused=True)
    return features.detach(), *(torch.zeros_like(a) if b is None else b for a, b in zip(needed, found, strict=True))


def both_ways(plane, uv, height, fade):
    """`gradients` by the kernels, and by the reference."""
    by_kernels = partial(read_by_kernels, plane)
    return gradients(plane, by_kernels, uv, height, fade), gradients(plane, plane, uv, height, fade)


@pytest.mark.slow
@pytest.mark.parametrize("sizes", PLANES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_gradients_are_torchs(sizes, dtype):
    plane = a_plane(*sizes).to(dtype)
    uv, height = hit_points(300)
    fade = torch.rand(300, generator=torch.Generator().manual_seed(1), dtype=dtype)
    tolerance = 1e-12 if dtype == torch.float64 else 3e-5
    ours, torchs = both_ways(plane, (1.2 * uv - 0.1).to(dtype), height.to(dtype), fade)
    names = ("features", "table", "uv", "height", "fade")
    for name, got, expected in zip(names, ours, torchs, strict=True):
        scale = expected.abs().max().clamp(min=1)
        torch.testing.assert_close(got / scale, expected / scale, atol=tolerance, rtol=tolerance, msg=name)


def test_gradients_on_the_border_on_texels_and_beyond_the_shell():
    """Where the clamps begin, and on texels, where the slope is the next cell's."""
    plane = a_plane(8, 3, 4).double()
    ends = torch.tensor([0.0, 1.0, 0.5 / 8, 7.5 / 8, 3.5 / 8, 4.0 / 8, -0.01, 1.01], dtype=torch.float64)
    layers = torch.tensor([-9.0, -1.0, -0.5, 0.0, 0.3, 1.0, 9.0], dtype=torch.float64)
    u, v, height = (values.flatten() for values in torch.meshgrid(ends, ends, layers, indexing="ij"))
    ours, torchs = both_ways(plane, torch.stack([u, v], -1), height, torch.full_like(u, 0.4))
    for got, expected in zip(ours, torchs, strict=True):
        torch.testing.assert_close(got, expected, atol=1e-11, rtol=1e-11)


def test_no_samples_give_no_gradient():
    plane = a_plane(4, 2, 4)
    features, of_table, *of_place = both_ways(plane, torch.zeros(0, 2), torch.zeros(0), torch.zeros(0))[0]
    assert features.shape == (0, 4)
    assert of_table.shape == plane.table.shape
    assert not of_table.any()
    assert [len(values) for values in of_place] == [0, 0, 0]


def test_gradients_are_the_same_to_the_last_bit_however_the_rows_are_shared_out():
    plane = a_plane(16, 3, 8)
    uv, height = (values.numpy() for values in hit_points(4000))
    outward = np.random.default_rng(0).standard_normal(4000 * 8, np.float32)
    fade = np.full(4000, 0.7, np.float32)

    def total(bounds):
        gradient = np.zeros(plane.table.numel(), np.float32)
        for first, last in itertools.pairwise(bounds):
            table_gradient((16, 3, 8), uv, height, fade, outward, 8, 0, first, last, gradient)
        return gradient

    whole = total([0, 16])
    assert np.abs(whole).max() > 0
    np.testing.assert_array_equal(total([0, 1, 2, 5, 15, 16]), whole)
    np.testing.assert_array_equal(total([0, 16]), whole)


def test_strided_gradients_and_places_are_read_right():
    """Gradients that come as columns of a wider one, and places that are not contiguous."""
    plane = a_plane(8, 2, 4)
    wide, height = torch.rand(50, 5, generator=torch.Generator().manual_seed(2)), hit_points(50)[1]
    uv, fade = wide[:, 1:4:2], wide[:, 4]
    outward = torch.rand(50, 9)[:, 2:6]
    (got,) = torch.autograd.grad(read_by_kernels(plane, uv, height, fade), [plane.table], outward)
    (expected,) = torch.autograd.grad(plane(uv, height, fade), [plane.table], outward)
    torch.testing.assert_close(got, expected)


def test_places_that_are_not_numbers_touch_nothing_else():
    plane = a_plane(8, 1, 3)  # odd: an index of the least integer does not wrap around to 0
    nowhere, inside = torch.full((1, 2), torch.nan), torch.full((1, 2), 0.9)
    features = read_by_kernels(plane, torch.cat([nowhere, inside]), torch.zeros(2), torch.ones(2))
    assert features[0].isnan().all()
    torch.testing.assert_close(features[1:], plane(inside, torch.zeros(1), torch.ones(len(inside))))
    features.nan_to_num().sum().backward()
