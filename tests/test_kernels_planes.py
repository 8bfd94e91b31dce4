"""Reading planes in the kernels against `field.encoding.FeaturePlane`."""

from importlib.util import find_spec

import numpy as np
import pytest
import torch
from livehand.backend.field.encoding import FeaturePlane

if find_spec("numba") is None:
    pytest.skip("numba is not installed", allow_module_level=True)

from livehand.backend.kernels.planes import BLOCK, read_plane

GUARD = 77.0


def read(plane, uv, height, fade=1.0, start=0, at=0):
    """[S, channels] by the kernel, from a table that begins at `start` of an array, written from `at` on."""
    table = np.concatenate([np.full(start, 1e9), plane.table.detach().numpy().ravel()]).astype(np.float32)
    sizes = plane.resolution, plane.heights, plane.channels
    rows = []
    for (u, v), h in zip(uv.numpy(), height.numpy(), strict=True):
        out = np.full(at + plane.channels + 2, GUARD, np.float32)
        read_plane(table, start, *sizes, u, v, h, np.float32(fade), out, at)
        assert (out[:at] == GUARD).all()
        assert (out[at + plane.channels :] == GUARD).all()
        rows.append(out[at : at + plane.channels])
    return torch.as_tensor(np.stack(rows))


def a_plane(resolution, heights, channels):
    torch.manual_seed(resolution + heights)
    return FeaturePlane(resolution, heights, channels, init=1.0)


def places(count, seed=0):
    generator = torch.Generator().manual_seed(seed)
    uv = torch.rand(count, 2, generator=generator)
    height = torch.rand(count, generator=generator) * 2.4 - 1.2
    return uv, height


@pytest.mark.parametrize(("resolution", "heights"), [(2, 1), (2, 2), (7, 1), (16, 3), (64, 6)])
@pytest.mark.parametrize("blocks", [1, 2, 3])
def test_anywhere(resolution, heights, blocks):
    plane = a_plane(resolution, heights, blocks * BLOCK)
    uv, height = places(80)
    torch.testing.assert_close(read(plane, uv, height), plane(uv, height).detach(), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("heights", [1, 2, 3])
def test_on_the_atlas_border_on_texels_and_beyond_the_shell(heights):
    """u and v at 0, at 1, on texel centres; heights on the layers, at the ends and past them."""
    plane = a_plane(8, heights, BLOCK)
    ends = torch.tensor([0.0, 1.0, 0.5 / 8, 7.5 / 8, 3.5 / 8, 4.0 / 8, -0.01, 1.01])
    u, v, height = torch.meshgrid(ends, ends, torch.tensor([-9.0, -1.0, -0.5, 0.0, 0.3, 1.0, 9.0]), indexing="ij")
    uv, height = torch.stack([u.flatten(), v.flatten()], -1), height.flatten()
    torch.testing.assert_close(read(plane, uv, height), plane(uv, height).detach(), atol=1e-5, rtol=1e-5)


def test_a_texels_centre_is_that_texel():
    plane = a_plane(4, 3, BLOCK)
    uv = torch.tensor([[2.5 / 4, 1.5 / 4]])
    for layer, height in enumerate((-1.0, 0.0, 1.0)):
        expected = plane.table.detach()[((1 * 4 + 2) * 3 + layer)]
        torch.testing.assert_close(read(plane, uv, torch.tensor([height]))[0], expected)


def test_fading_place_in_the_table_and_place_in_the_output():
    plane = a_plane(16, 3, 2 * BLOCK)
    uv, height = places(20, seed=3)
    expected = plane(uv, height).detach()
    torch.testing.assert_close(read(plane, uv, height, fade=0.25), expected * 0.25, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(read(plane, uv, height, start=40, at=5), expected, atol=1e-5, rtol=1e-5)
