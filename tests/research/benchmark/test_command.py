"""`livehand benchmark`: a tiny complete run, its JSON and tables, and refused arguments."""

import json

import pytest
import torch
from livehand.backend.avatars.avatar import PRESETS, AvatarConfig, new_avatar
from livehand.backend.avatars.file import save_avatar
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.research.benchmark import brute_force, command, measure
from livehand.backend.research.benchmark.machine import Peaks
from livehand.backend.research.benchmark.stopwatch import Cost
from livehand.backend.system.command import Command, run_commands
from PIL import Image

SMALL = AvatarConfig(
    FieldConfig(width=16, planes=((32, 2, 4),), relief=8), SuperResConfig(width=8, depth=2), SamplerConfig(4, 0.003)
)
ALL = ["default_bf16", "default_fp32", "paper_bf16", "paper_fp32", "published"]


@pytest.fixture(scope="module")
def avatar_path(tmp_path_factory):
    return saved(tmp_path_factory, SMALL)


@pytest.fixture(scope="module")
def paper_path(tmp_path_factory):
    return saved(tmp_path_factory, PRESETS["paper"])


def saved(tmp_path_factory, config):
    hand = load_default_hand()
    path = tmp_path_factory.mktemp("avatars") / "untrained.safetensors"
    save_avatar(new_avatar("untrained", hand.name, hand.sha256, config), path)
    return path


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    """No second-long products, no compilation."""
    monkeypatch.setattr(measure, "measure_peaks", lambda device: Peaks(1e11, 4e11, 2e10))
    monkeypatch.setattr(brute_force, "has_numba", lambda: False)


def run(*arguments, make_cycles=None):
    """The exit code."""
    benchmark = Command("benchmark", "", command.add_arguments, lambda args: command.run(args, make_cycles))
    return run_commands("livehand", "", {"benchmark": benchmark}, ["benchmark", *map(str, arguments)])


def fake_cycles(args):
    """A Cycles that takes a second per sample, and one to synchronise."""
    return lambda frame, samples: {"sync": Cost(1000.0, 1.0), "render": Cost(1000.0 * samples, 2.0)}


def test_a_tiny_complete_run(capsys, avatar_path, paper_path, tmp_path):
    sizes = ("--sizes", "24x36,32x48", "--paper-sizes", "32x48", "--cycles-sizes", "32x48")
    avatars = ("--avatar", avatar_path, "--paper-avatar", paper_path)
    cycles = ("--cycles-samples", "2,4", "--cycles-frames", 1)
    assert run(*sizes, *avatars, *cycles, "--frames", 2, "--device", "cpu", "--json", make_cycles=fake_cycles) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["machine"]["torch"] == torch.__version__
    assert {"cpu", "cores", "threads", "numba", "amx", "peaks"} <= result["machine"].keys()
    assert list(result["sizes"]) == ["24x36", "32x48"]
    small, large = result["sizes"].values()
    assert list(small["frame_ms"]) == list(small["floor_ms"]) == ALL[:2]
    assert small["ratio_paper"] == small["ratio_cycles"] == {}
    assert small["ratio_paper_bf16"] is None
    assert list(large["frame_ms"]) == [*ALL, "cycles_2", "cycles_4"]
    assert large["frames"] == dict.fromkeys(ALL, 2) | {"cycles_2": 1, "cycles_4": 1}
    assert list(large["peak_mb"]) == ALL
    check_size(large)


def check_size(document):
    """The figures of a size are consistent."""
    for name in ALL:
        stages = document["stages"][name]
        frame = document["frame_ms"][name]
        assert frame["p10"] <= frame["median"] <= frame["p90"]
        assert ("write" in stages) == name.startswith("default")
        whole = sum(figures["ms"] for stage, figures in stages.items() if stage != "write")
        assert frame["median"] == pytest.approx(whole, rel=0.01)  # of two frames the median is the mean
        assert document["core_s"][name]["median"] > 0
    for name in ALL[:4]:
        reported = [stage for stage in document["stages"][name] if stage != "write"]
        assert list(document["floor_ms"][name]) == reported
        assert list(document["over_floor"][name]) == reported
        for stage, times in document["over_floor"][name].items():
            floor = document["floor_ms"][name][stage]
            # Both are rounded: to 0.0001 and 0.01.
            assert times * floor == pytest.approx(document["stages"][name][stage]["ms"], rel=0.2)
    assert document["frame_ms"]["cycles_4"]["median"] == 4000
    assert document["ratio_cycles"]["4"]["bf16"] / document["ratio_cycles"]["2"]["bf16"] == pytest.approx(2, 0.01)
    assert set(document["ratio_paper"]) == {"bf16", "fp32"}
    assert document["ratio_paper_bf16"] > 0


def test_without_json_tables_are_printed_and_a_plot_is_drawn(capsys, avatar_path, tmp_path, monkeypatch):
    monkeypatch.setattr("livehand.backend.research.benchmark.growth.COVERAGES", (0.1,))
    monkeypatch.setattr("livehand.backend.research.benchmark.growth.HANDS", (1, 2))
    plot = tmp_path / "plot.png"
    sizes = ("--sizes", "32x48", "--paper-sizes", "32x48")
    assert run("--avatar", avatar_path, *sizes, "--frames", 1, "--device", "cpu", "--plot", plot) == 0
    out = capsys.readouterr().out
    assert "32x48, the hand covers " in out
    assert "published / default: " in out
    assert all(name in out for name in ALL)
    assert sum(line.split()[:1] == ["superres"] for line in out.splitlines()) == 3
    with Image.open(plot) as image:
        assert image.width > 1000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--frames", "0"), "--frames must be 1 or more, got 0"),
        (("--threads", "0"), "--threads must be 1 or more"),
        (("--coverage", "1.5"), "--coverage must be a share"),
        (("--coverage", "0"), "--coverage must be a share"),
        (("--plot", "plot.jpg"), "--plot must name a .png"),
        (("--avatar", "nowhere.safetensors"), "no avatar at nowhere.safetensors"),
    ],
)
def test_bad_input_ends_with_1_and_one_message(capsys, arguments, message):
    assert run(*arguments, "--sizes", "48x72") == 1
    out, err = capsys.readouterr()
    assert message in err
    assert (out, err.count("\n")) == ("", 1)


def test_a_paper_avatar_must_be_one(capsys, avatar_path):
    assert run("--avatar", avatar_path, "--paper-avatar", avatar_path, "--sizes", "48x72") == 1
    assert "must be trained with --config paper" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [("--sizes", "334"), ("--sizes", "8x8"), ("--cycles-samples", "0"), ("--sizes", "")]
)
def test_malformed_arguments_are_usage_errors(capsys, arguments):
    assert run(*arguments) == 2
    assert arguments[0] in capsys.readouterr().err


def test_sizes_have_names():
    assert command.parse_sizes("1080p, 334x512,1080p,2160P") == ((1920, 1080), (334, 512), (3840, 2160))
