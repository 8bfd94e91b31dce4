"""Files of splats, read again by other parsers."""

import json
import struct

import numpy as np
import pytest
import trimesh
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.splats.gaussians import Splats
from livehand.backend.render.splats.splat_files import file_axes, write_splats

COUNT = 7
FACTS = {"LiveHand/Avatar": "light", "LiveHand/PSNR": "34 dB\nin 8 views"}


@pytest.fixture
def splats():
    rng = np.random.default_rng(0)
    turns = rng.normal(size=(COUNT, 4))
    return Splats(
        rng.normal(size=(COUNT, 3)),
        turns / np.linalg.norm(turns, axis=1, keepdims=True),
        rng.random((COUNT, 3)) + 0.01,
        0.1 + 0.8 * rng.random(COUNT),
        rng.normal(size=(COUNT, 16, 3)),
        rng.normal(size=(COUNT, 3)),
        rng.random((COUNT, 3)),
    )


def vertex_data(path):
    metadata = trimesh.load(path, process=False).metadata
    return metadata["_ply_raw"]["vertex"]["data"]


def test_a_ply_has_the_layout_of_3d_gaussian_splatting(splats, tmp_path):
    write_splats(tmp_path / "hand.ply", splats, FACTS)
    head = (tmp_path / "hand.ply").read_bytes().split(b"end_header")[0].decode()
    names = [line.split()[-1] for line in head.splitlines() if line.startswith("property float")]
    rest = [f"f_rest_{index}" for index in range(45)]
    usual = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *rest, "opacity"]
    usual += ["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    assert names == [*usual, "albedo_0", "albedo_1", "albedo_2"]
    assert "comment LiveHand/PSNR: 34 dB in 8 views\n" in head
    data = vertex_data(tmp_path / "hand.ply")
    np.testing.assert_allclose(np.stack([data["x"], data["y"], data["z"]], 1), splats.positions, rtol=1e-6)
    np.testing.assert_allclose(1 / (1 + np.exp(-data["opacity"])), splats.opacity, rtol=1e-5)
    np.testing.assert_allclose(np.exp(data["scale_2"]), splats.scales[:, 2], rtol=1e-5)
    np.testing.assert_allclose(data["rot_0"], splats.rotations[:, 0], rtol=1e-6)
    np.testing.assert_allclose(data["f_dc_1"], splats.harmonics[:, 0, 1], rtol=1e-6)
    np.testing.assert_allclose(data["f_rest_0"], splats.harmonics[:, 1, 0], rtol=1e-6)
    np.testing.assert_allclose(data["f_rest_16"], splats.harmonics[:, 2, 1], rtol=1e-6)
    np.testing.assert_allclose(data["albedo_2"], splats.albedo[:, 2], rtol=1e-6)


def test_a_glb_has_the_attributes_of_khr_gaussian_splatting(splats, tmp_path):
    write_splats(tmp_path / "hand.glb", splats, FACTS)
    raw = (tmp_path / "hand.glb").read_bytes()
    assert struct.unpack("<4sII", raw[:12]) == (b"glTF", 2, len(raw))
    (length,) = struct.unpack("<I", raw[12:16])
    content, binary = json.loads(raw[20 : 20 + length]), raw[28 + length :]
    (primitive,) = content["meshes"][0]["primitives"]
    assert (content["extensionsUsed"], primitive["mode"]) == (["KHR_gaussian_splatting"], 0)
    kernel = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    assert primitive["extensions"]["KHR_gaussian_splatting"] == kernel
    assert content["asset"]["extras"] == FACTS

    def values(name):
        accessor = content["accessors"][primitive["attributes"][name]]
        view = content["bufferViews"][accessor["bufferView"]]
        assert accessor["componentType"] == 5126
        part = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        return np.frombuffer(part, "<f4").reshape(accessor["count"], -1)

    def of(name):
        return values(f"KHR_gaussian_splatting:{name}")

    np.testing.assert_allclose(of("ROTATION"), splats.rotations[:, [1, 2, 3, 0]], rtol=1e-6)
    np.testing.assert_allclose(of("SCALE"), splats.scales, rtol=1e-6)
    np.testing.assert_allclose(of("OPACITY")[:, 0], splats.opacity, rtol=1e-6)
    np.testing.assert_allclose(of("SH_DEGREE_3_COEF_6"), splats.harmonics[:, 15], rtol=1e-6)
    assert len([name for name in primitive["attributes"] if ":SH_DEGREE" in name]) == 16
    np.testing.assert_allclose(values("_ALBEDO"), splats.albedo, rtol=1e-6)
    assert values("COLOR_0").min() >= 0
    assert values("COLOR_0").max() <= 1
    bounds = content["accessors"][primitive["attributes"]["POSITION"]]
    np.testing.assert_allclose(bounds["min"], values("POSITION").min(0))


def test_files_stand_upright_in_their_own_axes(tmp_path):
    up, front = np.array([0, 0, 1.0]), np.array([0, -1.0, 0])
    np.testing.assert_allclose(file_axes(tmp_path / "a.ply") @ up, [0, -1, 0])
    np.testing.assert_allclose(file_axes(tmp_path / "a.ply") @ front, [0, 0, -1])
    np.testing.assert_allclose(file_axes(tmp_path / "a.glb") @ up, [0, 1, 0])
    np.testing.assert_allclose(file_axes(tmp_path / "a.glb") @ front, [0, 0, 1])
    for axes in (file_axes(tmp_path / "a.ply"), file_axes(tmp_path / "a.glb")):
        assert np.linalg.det(axes) == pytest.approx(1)
    with pytest.raises(LiveHandError, match=r"must end in \.ply or \.glb"):
        file_axes(tmp_path / "a.fbx")
