import sys

import numpy as np
import pytest
import torch
from livehand.backend.compute.cpu.networks import RowSuperRes, superres
from livehand.backend.compute.kernels.networks import DILATION, SPARE, fill_around, find_runs
from livehand.backend.compute.kernels.vectors import has_int8_products, has_vectors
from livehand.backend.image.maps import enlarge_maps
from livehand.backend.image.superres import SuperResConfig, build_superres
from torch.nn.functional import conv2d, leaky_relu, max_pool2d, pixel_shuffle

MAPS = {"light": 33, "lit": 34}
CPU = torch.device("cpu")
needs_vectors = pytest.mark.skipif(not has_vectors(), reason="needs a processor with AVX2 or AVX-512")
needs_int8_products = pytest.mark.skipif(not has_int8_products(), reason="needs a processor with AVX-512 VNNI")

precisions = pytest.mark.parametrize(
    "is_int8", [pytest.param(False, marks=needs_vectors), pytest.param(True, marks=needs_int8_products)]
)


def trained(kind, seed=0, width=64):
    """A network whose last layer adds something."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        network = build_superres(SuperResConfig(kind=kind, width=width)).eval()
        torch.nn.init.normal_(network.tail.weight, std=0.05)
    return network.requires_grad_(False)


def maps_of(alpha, channels, seed=1):
    values = torch.randn(1, channels, *alpha.shape, generator=torch.Generator().manual_seed(seed)) * alpha
    values[0, -1] = alpha
    return values


def disc(height, width, centre, radius):
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    return ((y - centre[0]) ** 2 + (x - centre[1]) ** 2 < radius**2).float()


SHAPES = {
    "inside": disc(31, 40, (15, 19), 9),
    "cut by three borders": disc(24, 23, (12, 11), 30)[:, 4:],
    "two parts": disc(40, 40, (8, 8), 5) + disc(40, 40, (30, 36), 4),
    "one pixel": disc(9, 9, (4, 4), 0.5),
    "nothing": torch.zeros(9, 9),
}


def by_torch(network, maps):
    """The network in fp32, every layer's values beside the runs replaced by its answer to nothing."""
    runs = np.zeros((maps.shape[2], 2), np.int64)
    find_runs(maps[0, -1].numpy(), runs)
    x = torch.arange(maps.shape[3])
    is_run = torch.stack([(x >= first) & (x < last) for first, last in runs])

    def kept(layer, values, nothing, is_residual):
        answers = []
        for one in (values, nothing):
            answer = leaky_relu(layer(one), 0.2)
            answers.append(answer + one if is_residual else answer)
        nothing = answers[1][:, :, 8:9, 8:9].expand(-1, -1, 17, 17)
        return torch.where(is_run, answers[0], nothing[:, :, :1, :1]), nothing

    values, nothing = kept(network.head, maps, torch.zeros(1, maps.shape[1], 17, 17), False)
    for layer in network.body:
        values, nothing = kept(layer, values, nothing, True)
    residual = pixel_shuffle(conv2d(values, *network.even_tail(), padding=1), 2)
    is_large = is_run.repeat_interleave(2, 0).repeat_interleave(2, 1)
    return network.added(maps, residual * is_large)


@needs_vectors
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("kind", "width"), [("light", 64), ("lit", 64), ("lit", 48), ("lit", 32)])
def test_rows_equal_the_slow_reference(kind, width, shape):
    network, maps = trained(kind, width=width), maps_of(SHAPES[shape], MAPS[kind])
    ours, exact = RowSuperRes.of(network, is_int8=False)(maps), by_torch(network, maps)
    torch.testing.assert_close(ours, exact, rtol=0, atol=2e-5)
    assert shape == "nothing" or exact.std() > 0.05


@needs_int8_products
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("kind", "width"), [("light", 64), ("lit", 64), ("lit", 48), ("lit", 32)])
@pytest.mark.slow
def test_int8_rounds_as_256_steps_of_every_layer_must(kind, width, shape):
    """A step is 1/255 of a layer's span; uniform rounding of 64 x 9 inputs and weights leaves a hundredth of it."""
    network, maps = trained(kind, width=width), maps_of(SHAPES[shape], MAPS[kind])
    ours, exact = RowSuperRes.of(network, is_int8=True)(maps), by_torch(network, maps)
    assert ours.shape == exact.shape
    assert (ours - exact).square().mean().sqrt() <= 0.02 * max(exact.std(), 0.05)


@needs_int8_products
def test_maps_are_rounded_as_finely_as_they_count():
    """A map a thousand times as large as another, of weights as much smaller, leaves the other its 256 steps."""
    network, maps = trained("lit"), maps_of(SHAPES["inside"], 34)
    exact = by_torch(network, maps)
    maps[:, :33:2] *= 1000
    network.head.weight[:, :33:2] /= 1000
    ours = RowSuperRes.of(network, is_int8=True)(maps)
    assert (ours - exact).square().mean().sqrt() <= 0.02 * exact.std()


@pytest.mark.slow
@needs_int8_products
def test_int8_sums_are_exact():
    """Weights and values that int8 holds: nothing but the sums' own order is left to differ."""
    network = build_superres(SuperResConfig(kind="lit")).requires_grad_(False)
    random = torch.Generator().manual_seed(3)
    for layer in (network.head, *network.body, network.tail):
        layer.weight.zero_()
        layer.bias.zero_()
    for channel in range(34):
        network.head.weight[channel, channel, 1, 1] = 1.0
    window = torch.randint(-127, 128, (network.tail.out_channels // 4, 64, 3, 3), generator=random).float()
    window[:, 0, 0, 0] = 127
    turned = [
        window,
        window.flip(3),
        window.flip(2),
        window.flip(2, 3),
    ]  # of equal sums, so that `even_tail` keeps them
    network.tail.weight[:] = torch.stack(turned, 1).flatten(0, 1)
    maps = torch.randint(0, 256, (1, 34, 12, 12), generator=random) * disc(12, 12, (6, 6), 4)
    maps[0, 0, 6, 6], maps[0, -1] = 255.0, 255 * disc(12, 12, (6, 6), 4)
    rows = RowSuperRes.of(network, is_int8=True)
    torch.testing.assert_close(rows(maps), by_torch(network, maps), rtol=1e-6, atol=0.5)


@pytest.mark.parametrize(
    "is_int8", [pytest.param(False, marks=needs_vectors), pytest.param(True, marks=needs_int8_products)]
)
def test_a_single_window_is_the_sum_of_its_products(is_int8):
    """One weight a layer is not zero: a pixel of the map must arrive, shifted, in one pixel of the result."""
    network = build_superres(SuperResConfig(kind="lit")).requires_grad_(False)
    for layer in (network.head, *network.body, network.tail):
        layer.weight.zero_()
        layer.bias.zero_()
    network.head.weight[5, 33, 0, 2] = 2.0  # from the upper right
    network.tail.weight[4 * 7 + 2, 5, 1, 1] = 0.5  # channel 7, lower left of the four
    network.tail.weight[4 * 7 + 2, 5, 0, 1] = -0.5  # the window's sum is zero, as the other three pixels' are
    maps = torch.zeros(1, 34, 12, 12)
    maps[0, 33, 4:9, 3:9] = torch.arange(1.0, 31.0).reshape(5, 6) / 32
    result = RowSuperRes.of(network, is_int8)(maps)
    expected = torch.zeros(12, 24, 24)
    arrived = torch.roll(maps[0, 33], (1, -1), (0, 1))
    expected[7, 1::2, ::2] = arrived - torch.roll(arrived, 1, 0)
    torch.testing.assert_close(result[0], expected, rtol=0, atol=0.004 if is_int8 else 0)
    torch.testing.assert_close(network(maps)[0], expected, rtol=0, atol=1e-6)


@needs_vectors
def test_bands_leave_no_seam():
    network, alpha = trained("lit"), disc(64, 30, (32, 15), 26)
    maps = maps_of(alpha, 34)[0]
    rows = RowSuperRes.of(network, is_int8=False)
    whole, bands = enlarge_maps(rows, maps), enlarge_maps(rows, maps, pixels_per_band=20 * 30)
    torch.testing.assert_close(bands, whole, rtol=0, atol=0)


@pytest.mark.parametrize(
    "is_int8", [pytest.param(False, marks=needs_vectors), pytest.param(True, marks=needs_int8_products)]
)
def test_threads_change_nothing(is_int8):
    network, maps = trained("lit"), maps_of(disc(120, 60, (60, 30), 25), 34)
    rows, before = RowSuperRes.of(network, is_int8), torch.get_num_threads()
    results = []
    try:
        for threads in (1, 2, 3):
            torch.set_num_threads(threads)
            results.append(rows(maps))
    finally:
        torch.set_num_threads(before)
    assert all(torch.equal(results[0], other) for other in results[1:])


def test_what_the_kernels_do_not_fit_is_left_to_torch():
    maps = maps_of(SHAPES["inside"], 34)
    network = build_superres(SuperResConfig(kind="lit", width=40)).requires_grad_(False)
    found = superres(network, CPU, "bf16")
    assert not isinstance(found, RowSuperRes)
    assert found(maps).shape == (1, 12, 62, 80)


def test_a_processor_without_vectors_leaves_all_to_torch(monkeypatch):
    module = sys.modules[superres.__module__]
    monkeypatch.setattr(module, "has_vectors", lambda: False)
    network, maps = trained("lit"), maps_of(SHAPES["inside"], 34)
    found = superres(network, CPU, "fp32")
    assert not isinstance(found, RowSuperRes)
    torch.testing.assert_close(found(maps), network(maps), rtol=0, atol=0)


def test_runs_are_the_dilated_hand():
    alpha = SHAPES["two parts"]
    runs = np.full((40, 2), -1)
    find_runs(alpha.numpy(), runs)
    dilated = max_pool2d(alpha[None], 2 * DILATION + 1, stride=1, padding=DILATION)[0]
    for row, (first, last) in zip(dilated, runs, strict=True):
        live = row.nonzero()[:, 0]
        assert (first, last) == ((int(live[0]), int(live[-1]) + 1) if len(live) else (0, 0))


def test_windows_of_runs_read_nothing_that_was_not_written():
    alpha = SHAPES["two parts"]
    runs = np.zeros((40, 2), np.int64)
    find_runs(alpha.numpy(), runs)
    image = np.full((42, 42 + SPARE, 2), 9, np.uint8)
    in_runs = np.zeros((42, 42 + SPARE), bool)
    for y, (first, last) in enumerate(runs):
        in_runs[y + 1, first + 1 : last + 1] = True
    fill_around(runs, np.array([3, 4], np.uint8), np.uint8(7), 0, 42, image)
    assert (image[in_runs] == 9).all()
    read = conv2d(torch.as_tensor(in_runs).float()[None, None], torch.ones(1, 1, 3, 3), padding=1)[0, 0].numpy() > 0
    filled = image[read & ~in_runs]
    assert len(filled) > 80
    assert set(map(tuple, filled.tolist())) == {(3, 4), (7, 7)}  # the second in the border
    inside = np.zeros_like(in_runs)
    inside[1:-1, 1:41] = True
    assert (image[read & ~in_runs & inside] == (3, 4)).all()
    assert (image[read & ~inside] == 7).all()
