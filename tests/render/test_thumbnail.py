"""The thumbnail in an avatar's file."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.avatars.library import SKINS, shipped_avatar_path
from livehand.backend.avatars.metadata import read_metadata
from livehand.backend.render.renderer import Renderer
from livehand.backend.render.thumbnail import SIDE_PX, render_thumbnail, with_thumbnail
from livehand.backend.system.command import run_commands
from livehand.livehand_blender.cli import COMMANDS

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def thumbnail(hand):
    return render_thumbnail(Renderer(load_avatar(), hand, "cpu"))


def test_it_shows_the_whole_hand_fingers_up(thumbnail):
    assert thumbnail.shape == (SIDE_PX, SIDE_PX, 4)
    assert thumbnail.dtype == np.uint8
    rows, columns = np.nonzero(thumbnail[..., 3] > 128)
    assert 0.85 * SIDE_PX < np.ptp(rows) < SIDE_PX - 2
    assert columns.min() > 1
    assert columns.max() < SIDE_PX - 2
    hand = thumbnail[..., 3] > 128
    assert hand[: SIDE_PX // 3].sum() < hand[SIDE_PX // 3 : 2 * SIDE_PX // 3].sum()  # fingers above the palm


def test_it_shows_the_skin(thumbnail):
    """The light skin's mean, encoded, redder than green than blue; the background is transparent."""
    skin = thumbnail[thumbnail[..., 3] == 255][:, :3].mean(0)
    assert skin[0] > skin[1] + 20 > skin[2] + 20
    assert 120 < skin[0] < 230
    assert thumbnail[0, 0, 3] == 0


@pytest.mark.parametrize(
    "skin", ["light", *(pytest.param(skin, marks=pytest.mark.nightly) for skin in SKINS if skin != "light")]
)
def test_shipped_avatars_have_theirs(skin, hand):
    path = shipped_avatar_path(skin)
    stored = read_metadata(path).thumbnail
    assert stored is not None
    now = render_thumbnail(Renderer(load_avatar(path), hand, "cpu"))
    # Of 255; files were written before outlines were those of the known surface (light: 1.3), and processors differ.
    assert np.abs(stored.astype(int) - now).mean() < 2


def test_it_shows_a_drawn_person_in_their_own_shape(hand):
    avatar = load_avatar()

    def share(girth):
        person = replace(avatar.surface.person, beta=(0.0, girth, *[0.0] * 8))
        drawn = replace(avatar, surface=replace(avatar.surface, person=person))
        return (render_thumbnail(Renderer(drawn, hand, "cpu"))[..., 3] > 128).mean()

    assert share(3.0) > 1.08 * share(-3.0)


def test_it_survives_the_file(tmp_path, thumbnail):
    save_avatar(replace(load_avatar(), thumbnail=thumbnail), tmp_path / "a.safetensors")
    back = load_avatar(tmp_path / "a.safetensors").thumbnail
    assert back is not None
    np.testing.assert_array_equal(back, thumbnail)


def test_an_avatar_of_a_refined_surface_gets_one(thumbnail, hand):
    """The avatar then belongs to the refined hand model, which training has not loaded."""
    refined = with_thumbnail(replace(load_avatar(), hand_sha256="ab" * 32), hand, "cpu")
    assert refined.hand_sha256 == "ab" * 32
    np.testing.assert_array_equal(refined.thumbnail, thumbnail)


def test_the_command_renders_it_and_keeps_everything_else(tmp_path, thumbnail):
    path = tmp_path / "a.safetensors"
    before = replace(load_avatar(), thumbnail=None)
    save_avatar(before, path)
    assert read_metadata(path).thumbnail is None
    assert run_commands("livehand", "", COMMANDS, ["thumbnail", str(path), "--device", "cpu"]) == 0
    after = load_avatar(path)
    np.testing.assert_array_equal(after.thumbnail, thumbnail)
    assert (after.metrics, after.provenance, after.name) == (before.metrics, before.provenance, before.name)
    for key, value in before.field.state_dict().items():
        assert (after.field.state_dict()[key] == value).all()


def test_the_command_refuses_another_hand(tmp_path, capsys):
    path = tmp_path / "a.safetensors"
    save_avatar(replace(load_avatar(), hand_sha256="ab" * 32, surface=None), path)
    before = path.read_bytes()
    assert run_commands("livehand", "", COMMANDS, ["thumbnail", str(path)]) == 1
    assert "must be given its own hand model" in capsys.readouterr().err
    assert path.read_bytes() == before


def test_the_command_does_not_write_into_a_record_of_numbers(tmp_path, capsys, monkeypatch):
    path = Path(shutil.copy(shipped_avatar_path("lena"), tmp_path))
    before = path.read_bytes()
    monkeypatch.setattr("livehand.backend.avatars.drawn_people.drawn_avatar", lambda hand, look, name, base: base)
    assert run_commands("livehand", "", COMMANDS, ["thumbnail", str(path), "--device", "cpu"]) == 1
    assert "must be an avatar with networks to be written into" in capsys.readouterr().err
    assert path.read_bytes() == before
