"""From rays to the picture: where each ray goes, and that bands do not show."""

import pytest
import torch
from livehand.backend.field.field import CHANNELS
from livehand.backend.field.volume import Composite
from livehand.backend.image.crop import MARGIN_PX
from livehand.backend.image.maps import enlarge_maps, image_of, low_resolution_maps
from livehand.backend.image.superres import SuperResConfig, build_superres

CONFIGS = {"paper": SuperResConfig(kind="paper"), "light": SuperResConfig(width=8)}


@pytest.fixture(params=CONFIGS)
def network(request):
    """With weights that are no longer zero at the end."""
    torch.manual_seed(0)
    network = build_superres(CONFIGS[request.param])
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.05 * torch.randn_like(parameter))
    return network


def some_rays(count):
    generator = torch.Generator().manual_seed(count)
    alpha = torch.rand(count, generator=generator)
    return Composite(torch.randn(count, CHANNELS, generator=generator), alpha, 0.4 + alpha, alpha[:, None])


def maps_of(height, width):
    return torch.randn(CHANNELS + 1, height, width, generator=torch.Generator().manual_seed(height))


@pytest.mark.slow
@torch.inference_mode()
@pytest.mark.parametrize("rows", [1, 5, 8, 11])
def test_enlarging_in_bands_equals_enlarging_at_once(network, rows):
    """Bands of one row up to nearly all: the paper's network aligns its grids with the picture's border as well."""
    maps = maps_of(23, 9)
    whole = network(maps[None])[0]
    calls = []
    network.register_forward_pre_hook(lambda module, inputs: calls.append(inputs[0].shape[2]))
    torch.testing.assert_close(enlarge_maps(network, maps, 9 * rows), whole, atol=1e-5, rtol=1e-5)
    assert len(calls) == -(-23 // rows)
    assert max(calls) <= rows + 2 * MARGIN_PX


@torch.inference_mode()
def test_a_row_wider_than_the_band_is_a_band(network):
    maps = maps_of(4, 30)
    whole = network(maps[None])[0]
    torch.testing.assert_close(enlarge_maps(network, maps, 7), whole, atol=1e-5, rtol=1e-5)


@torch.inference_mode()
def test_small_maps_are_enlarged_at_once(network):
    maps = maps_of(6, 5)
    at_once = network(maps[None].contiguous(memory_format=torch.channels_last))[0]
    assert torch.equal(enlarge_maps(network, maps), at_once)


def test_rays_go_to_their_pixels():
    low, pixel = some_rays(3), torch.tensor([7, 0, 4])
    maps, depth = low_resolution_maps(low, pixel, (4, 2))
    assert (maps.shape, depth.shape) == ((CHANNELS + 1, 2, 4), (2, 4))
    for ray, (row, column) in enumerate(((1, 3), (0, 0), (1, 0))):
        torch.testing.assert_close(maps[:CHANNELS, row, column], low.channels[ray])
        assert float(maps[CHANNELS, row, column]) == float(low.alpha[ray])
        assert float(depth[row, column]) == float(low.depth[ray])
    empty = torch.tensor([[1, 2, 3], [5, 6, 6]])
    assert (maps.flatten(1)[:, empty] == 0).all()
    assert depth.flatten()[empty].isinf().all()


def test_a_ray_that_met_nothing_has_no_depth_and_no_rays_give_empty_maps():
    low = some_rays(2)._replace(alpha=torch.tensor([0.0, 0.5]), depth=torch.tensor([0.0, 0.7]))
    _, depth = low_resolution_maps(low, torch.tensor([1, 2]), (3, 1))
    assert depth.tolist() == [[torch.inf, torch.inf, pytest.approx(0.7)]]
    maps, depth = low_resolution_maps(some_rays(0), torch.zeros(0, dtype=torch.long), (3, 2))
    assert (maps == 0).all()
    assert depth.isinf().all()


@torch.inference_mode()
def test_the_picture_is_twice_as_large_and_so_is_its_depth(network):
    low, pixel = some_rays(3), torch.tensor([0, 5, 2])
    picture, depth = image_of(network, low, pixel, (3, 2), 2)
    maps, low_depth = low_resolution_maps(low, pixel, (3, 2))
    torch.testing.assert_close(picture, network(maps[None])[0])
    assert torch.equal(depth, low_depth[torch.arange(4)[:, None] // 2, torch.arange(6) // 2])
