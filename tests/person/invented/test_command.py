"""`livehand new-person`: what it refuses before it works, and the whole road to a relightable avatar."""

import argparse

import numpy as np
import pytest
from livehand.backend.avatars.drawn_people import nearest_base
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.metadata import read_metadata
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.person.invented.command import COMMAND
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.albedo import vertex_albedo
from livehand.backend.surface.people.look import NUMBERS


@pytest.fixture
def run(tmp_path):
    """A function of options: the command's report."""

    def run(*options, output="anna.safetensors"):
        parser = argparse.ArgumentParser()
        COMMAND.add_arguments(parser)
        return COMMAND.run(parser.parse_args(["-o", str(tmp_path / output), *options]))

    return run


def test_numbers_beyond_limits_leave_nothing(run, tmp_path):
    for name, spec in NUMBERS.items():
        with pytest.raises(LiveHandError, match=f"{name} must be from"):
            run(f"--{name}", str(spec.high + 1))
    with pytest.raises(LiveHandError, match="seed must be"):
        run("--seed", "-3")
    with pytest.raises(LiveHandError, match=r"\.safetensors file, got anna.png"):
        run(output="anna.png")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("tone", "base"), [(0.0, "light"), (0.3, "middle"), (0.9, "deep"), (1.2, "deep")])
def test_the_nearest_base_is_taken(tone, base):
    assert nearest_base(tone, load_avatar).name == base


@pytest.mark.nightly
def test_a_person_is_made_whole(run, tmp_path):
    report = run("--seed", "7", "--age", "60", "--tone", "0.7", "--name", "Anna")
    path = tmp_path / "anna.safetensors"
    avatar = load_avatar(path)
    assert (report["seed"], report["age"], report["tone"]) == (7, 60, 0.7)
    assert avatar.name == "Anna"
    assert avatar.provenance["look"]["tone"] == 0.7
    assert avatar.surface.person.melanin == 0.7
    metadata = read_metadata(path)
    assert metadata.thumbnail.shape == (192, 192, 4)
    assert metadata.beta == avatar.surface.person.beta
    albedo = np.median(vertex_albedo(avatar, load_default_hand()), 0)
    assert 0.12 < albedo[0] < 0.45
    assert albedo[0] > albedo[1] > albedo[2]
