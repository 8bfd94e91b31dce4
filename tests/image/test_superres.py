"""Super-resolution: how it starts, how its grids lie, and any size."""

import pytest
import torch
from livehand.backend.field.field import CHANNELS
from livehand.backend.image.superres import SuperResConfig, build_superres, enlarge

CONFIGS = {"paper": SuperResConfig(kind="paper"), "light": SuperResConfig(width=8)}


@pytest.fixture(params=CONFIGS)
def network(request):
    torch.manual_seed(0)
    return build_superres(CONFIGS[request.param]).double()


def trained(network):
    """With weights that are no longer zero at the end."""
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.05 * torch.randn_like(parameter))
    return network


def maps_of(height, width, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(1, CHANNELS + 1, height, width, generator=generator, dtype=torch.float64)


def test_it_starts_as_bilinear_enlargement_of_colour_and_alpha(network):
    maps = maps_of(6, 9)
    torch.testing.assert_close(network(maps), enlarge(maps[:, [0, 1, 2, CHANNELS]]))
    assert not torch.allclose(trained(network)(maps), enlarge(maps[:, [0, 1, 2, CHANNELS]]), atol=1e-3)


def test_enlarging_a_ramp_keeps_the_grids_corners_together():
    """Pixel centres of the low grid at 1, 3, 5 ... on the full one: the ramp x goes on in steps of a half."""
    low = torch.arange(6, dtype=torch.float64).expand(1, 1, 4, 6)
    full = enlarge(low)[0, 0, 3]
    torch.testing.assert_close(full[1:-1], torch.arange(12, dtype=torch.float64)[1:-1] / 2 - 0.25)
    assert float(full[0]) == 0  # the border holds


def test_two_by_two_means_of_an_enlarged_constant_are_that_constant():
    low = torch.full((1, 2, 5, 3), 0.37, dtype=torch.float64)
    torch.testing.assert_close(enlarge(low), torch.full((1, 2, 10, 6), 0.37, dtype=torch.float64))


def test_moving_the_input_by_one_pixel_moves_the_output_by_two(network):
    network = trained(network)
    maps = maps_of(20, 22)
    down_right = torch.roll(maps, (1, 1), (2, 3))
    reach = 2 * 7
    inner = slice(reach, -reach)
    moved = torch.roll(network(maps), (2, 2), (2, 3))
    torch.testing.assert_close(network(down_right)[..., inner, inner], moved[..., inner, inner])


def test_what_is_far_has_no_influence(network):
    """The window's margin is wide enough: see window.MARGIN_PX."""
    from livehand.backend.image.crop import MARGIN_PX

    network = trained(network)
    maps = maps_of(30, 30)
    changed = maps.clone()
    changed[..., 0, :] += 1
    difference = (network(changed) - network(maps)).abs().amax((0, 1, 3))
    assert difference[0] > 1e-3
    assert difference[2 * (MARGIN_PX + 1) :].max() == 0


@pytest.mark.parametrize("size", [(1, 1), (3, 17), (16, 16)])
def test_any_size(network, size):
    maps = maps_of(*size)
    assert network(maps).shape == (1, 4, 2 * size[0], 2 * size[1])


def test_memory_layout_does_not_matter(network):
    network, maps = trained(network), maps_of(8, 8)
    torch.testing.assert_close(network(maps.contiguous(memory_format=torch.channels_last)), network(maps))


def test_every_input_map_is_used(network):
    network = trained(network)
    maps = maps_of(8, 8).requires_grad_()
    network(maps).square().sum().backward()
    assert (maps.grad.abs().amax((0, 2, 3)) > 0).all()


def test_an_even_image_has_no_lattice(network):
    """The four pixels of each group are equal, whatever was learnt; changes of the image still reach them apart."""
    network = trained(network)
    even = maps_of(1, 1).expand(-1, -1, 24, 24)
    image = network(even)[..., 20:-20, 20:-20]
    torch.testing.assert_close(image, image[..., :1, :1].expand_as(image))
    groups = network(maps_of(24, 24))[..., 20:-20, 20:-20].unflatten(3, (-1, 2))
    assert (groups[..., 0] - groups[..., 1]).abs().mean() > 0.01
