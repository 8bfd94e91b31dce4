"""`livehand extract-mesh`: the mesh of a density that is known, and its distance from the surface."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
from livehand.backend.avatars.avatar import PRESETS, new_avatar
from livehand.backend.avatars.file import save_avatar
from livehand.backend.commands.extract_mesh.density_volume import distances_m
from livehand.backend.field.field import PRIOR_OFFSET, PRIOR_SLOPE
from livehand.backend.hand.lbs import posed_arrays
from livehand.backend.records.shot import HandPose, SurfaceMesh
from livehand.livehand_blender.cli import main

pytestmark = pytest.mark.slow
SPACING_MM = 4
TALL = 0.25  # of the shell, where the density of a field that has learnt nothing is this:
DENSITY = float(torch.nn.functional.softplus(torch.tensor(PRIOR_SLOPE * TALL + PRIOR_OFFSET)))


@pytest.fixture
def avatar(hand, tmp_path):
    """The path of an avatar whose density is the prior's, which falls with the height alone."""

    def avatar(name):
        config = replace(PRESETS[name], field=replace(PRESETS[name].field, planes=((8, 2, 2),), relief=8))
        made = new_avatar("plain", hand.name, hand.sha256, config if name != "paper" else PRESETS[name])
        with torch.no_grad():
            made.field.density.weight.zero_()
            made.field.density.bias.zero_()
        save_avatar(made, tmp_path / "plain.safetensors")
        return tmp_path / "plain.safetensors"

    return avatar


@pytest.mark.parametrize("name", ["default", "paper"])
def test_the_mesh_lies_where_the_density_is_the_level(avatar, hand, tmp_path, capsys, name):
    out = tmp_path / "out" / "mesh.ply"
    arguments = ["--spacing", str(SPACING_MM), "--density", str(DENSITY), "--json"]
    assert main(["extract-mesh", str(avatar(name)), "-o", str(out), *arguments]) == 0
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    mesh = trimesh.load(out, process=False)
    assert (len(mesh.vertices), len(mesh.faces)) == (facts["vertices"], facts["faces"])
    assert mesh.is_watertight
    vertices, _ = posed_arrays(hand, HandPose.rest(hand.side))
    apart_mm = 1000 * distances_m(np.asarray(mesh.vertices), SurfaceMesh(vertices, hand.f))
    height_mm = 1000 * TALL * PRESETS[name].sampler.shell_m
    assert np.median(apart_mm) == pytest.approx(height_mm, abs=0.15)
    assert facts["surface_error_mean_mm"] == pytest.approx(apart_mm.mean(), abs=2e-3)


def test_distances_are_those_of_the_nearest_face():
    triangle = SurfaceMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    points = np.array([[0.2, 0.2, 0.5], [2.0, 0, 0], [0.6, 0.6, 0]])
    np.testing.assert_allclose(distances_m(points, triangle), [0.5, 1, 0.1 * np.sqrt(2)], atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "mesh.blend"], r"one of \.ply, \.obj, \.stl, got mesh\.blend"),
        (["-o", "mesh.ply", "--spacing", "0.05"], "the grid must have at most"),
        (["-o", "mesh.ply", "--spacing", "8", "--density", "1e12"], "must cross 1e\\+12 per mm .* a smaller --density"),
        (["-o", "mesh.ply", "--spacing", "8", "--density", "1e-9"], "must cross 1e-09 per mm .* a larger --density"),
    ],
)
def test_what_gives_no_mesh_is_refused(avatar, tmp_path, capsys, monkeypatch, arguments, message):
    path = avatar("default")
    monkeypatch.chdir(tmp_path)
    assert main(["extract-mesh", str(path), *arguments]) == 1
    assert re.search(message, capsys.readouterr().err)
    assert not list(tmp_path.glob("mesh*"))
