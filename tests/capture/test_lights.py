"""Lights of a capture: there and back exactly, every fault named; linear pixels whatever the file's kind."""

import json
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.capture.capture import Capture, CaptureView, index_document, load_capture, save_capture_index
from livehand.backend.capture.exr import write_exr
from livehand.backend.capture.lights import CaptureLight
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.light import Lamp, Light, Sky
from livehand.backend.records.shot import HandPose
from PIL import Image

SIZE = (6, 9)
ROTATION = look_at(np.array([0.3, 0.2, 0.1]), np.zeros(3), np.array([0, 0, 1.0]))[:3, :3]
CAMERA = Camera(np.array([[50.0, 0, 3], [0, 50, 4.5], [0, 0, 1]]), look_at(np.ones(3), np.zeros(3), np.eye(3)[2]), SIZE)


def a_capture(folder):
    rng = np.random.default_rng(0)
    lamps = (
        Lamp("sun", rng.uniform(size=3), rotation=ROTATION, angle_rad=0.01, group="key"),
        Lamp("spot", rng.uniform(size=3), rng.normal(size=3), ROTATION, 0.02, cone_rad=0.4, blend=0.7),
        Lamp(
            "area",
            rng.uniform(size=3),
            rng.normal(size=3),
            ROTATION,
            size_m=(0.1, 0.3),
            is_ellipse=True,
            spread_rad=2.0,
        ),
        Lamp("point", rng.uniform(size=3), rng.normal(size=3), casts_shadow=False),
    )
    full = rng.uniform(0, 1e6, (4, 8, 3)).astype(np.float32)
    half = rng.uniform(0, 9, (32, 64, 3)).astype(np.float16).astype(np.float32)
    lights = (
        CaptureLight("soft", Light(lamps, Sky(full, "sky"), rng.normal(size=(2, 3, 3)), rng.uniform(size=(2, 3)))),
        CaptureLight("key", Light(lamps[:1])),
        CaptureLight("", Light(sky=Sky(half))),
    )
    views = (
        CaptureView("images/0.exr", CAMERA, 0, 0, "train", light=0),
        CaptureView("images/1.exr", CAMERA, 0, 0, "train", light=2, exposure=0.3),
        CaptureView("images/2.png", CAMERA, 1, 0, "novel_light", light=1, exposure=2.0),
        CaptureView("images/3.exr", CAMERA, 2, 0, "test", "mask.png"),
    )
    return Capture(folder, "ab" * 32, {}, (HandPose.rest(),), views, lights)


@pytest.fixture
def capture(tmp_path):
    made = a_capture(tmp_path)
    save_capture_index(made)
    return made


def assert_equal_records(one, other):
    for name, value in vars(one).items():
        if hasattr(value, "__dataclass_fields__"):
            assert_equal_records(value, getattr(other, name))
        else:
            np.testing.assert_array_equal(value, getattr(other, name))


def test_round_trip_is_exact(capture):
    back = load_capture(capture.folder)
    assert [(v.file, v.light, v.exposure, v.mask, v.split) for v in back.views] == [
        (v.file, v.light, v.exposure, v.mask, v.split) for v in capture.views
    ]
    for one, other in zip(back.lights, capture.lights, strict=True):
        assert one.kind == other.kind
        np.testing.assert_array_equal(one.light.occluder_albedo, other.light.occluder_albedo)
        np.testing.assert_array_equal(one.light.occluders, other.light.occluders)
        assert len(one.light.lamps) == len(other.light.lamps)
        for lamp, written in zip(one.light.lamps, other.light.lamps, strict=True):
            assert_equal_records(lamp, written)
        assert (one.light.sky is None) == (other.light.sky is None)
        if one.light.sky is not None:
            assert_equal_records(one.light.sky, other.light.sky)
    assert index_document(back) == index_document(capture)
    assert back.light_of(back.views[3]) is None
    assert back.light_of(back.views[2]) is back.lights[1].light


def test_a_capture_without_lights_is_of_version_1(capture):
    views = tuple(replace(view, file="a.png", light=None, exposure=1.0) for view in capture.views[2:3])
    document = json.loads(index_document(replace(capture, views=views, lights=())))
    assert document["version"] == 1
    assert not {"lights"} & set(document)
    assert not {"light", "exposure"} & set(document["frames"][0])
    for change in ({"exposure": 2.0}, {"file": "a.exr"}):
        lit = replace(capture, views=(replace(views[0], **change),), lights=())
        assert json.loads(index_document(lit))["version"] == 2


def test_version_1_knows_no_lights(capture):
    path = capture.folder / "transforms.json"
    document = json.loads(path.read_text())
    document["version"] = 1
    path.write_text(json.dumps(document))
    back = load_capture(capture.folder)
    assert back.lights == ()
    assert {(view.light, view.exposure) for view in back.views} == {(None, 1.0)}


def test_linear_images_are_read_as_they_are(capture):
    rng = np.random.default_rng(1)
    pixels = rng.uniform(0, 20, (SIZE[1], SIZE[0], 4)).astype(np.float16)
    pixels[..., 3] = rng.uniform(0, 1, pixels.shape[:2])
    for view in capture.views[:2]:
        write_exr(capture.folder / view.file, {name: pixels[..., k] for k, name in enumerate("RGBA")})
    first, second = (capture.read_linear(view) for view in capture.views[:2])
    assert first.dtype == np.float32
    np.testing.assert_array_equal(first, pixels.astype(np.float32))
    np.testing.assert_allclose(second[..., :3], pixels[..., :3].astype(float) / 0.3, rtol=1e-6)
    np.testing.assert_array_equal(second[..., 3], first[..., 3])
    with pytest.raises(LiveHandError, match=r"images/0\.exr must be an 8-bit image here"):
        capture.read_image(capture.views[0])


def test_encoded_images_are_decoded_and_their_exposure_divided_out(capture):
    (capture.folder / "images").mkdir()
    Image.new("RGBA", SIZE, (188, 0, 255, 128)).save(capture.folder / "images/2.png")
    alpha = 128 / 255
    expected = np.array([0.5029 * alpha / 2, 0, alpha / 2, alpha])  # 188 of 255 encodes 0.5029
    np.testing.assert_allclose(capture.read_linear(capture.views[2]), np.broadcast_to(expected, (9, 6, 4)), atol=1e-4)


def test_a_mask_takes_the_place_of_alpha(capture):
    view, half = capture.views[3], np.full((9, 6), 0.5, np.float16)
    Image.new("L", SIZE, 51).save(capture.folder / "mask.png")
    write_exr(capture.folder / view.file, dict.fromkeys("RGB", half))
    np.testing.assert_allclose(capture.read_linear(view), np.broadcast_to([0.1, 0.1, 0.1, 0.2], (9, 6, 4)), rtol=1e-6)
    write_exr(capture.folder / view.file, dict.fromkeys("RGBA", half))  # colour 1 under alpha 0.5
    np.testing.assert_allclose(capture.read_linear(view), np.full((9, 6, 4), 0.2), rtol=1e-6)


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        (dict.fromkeys("RGB", np.ones((9, 6), np.float16)), "must have alpha"),
        (dict.fromkeys("RGBA", np.ones((6, 9), np.float16)), r"must be \(6, 9\) px like its camera, got \(9, 6\)"),
        (dict.fromkeys("RGBA", np.full((9, 6), np.nan, np.float16)), "must be finite"),
        (dict.fromkeys("RGBA", np.full((9, 6), 1.5, np.float16)), "alpha in"),
        (dict.fromkeys("YA", np.ones((9, 6), np.float16)), "must have channels R, G and B"),
    ],
)
def test_bad_linear_images_are_named(capture, channels, message):
    write_exr(capture.folder / "images/0.exr", channels)
    with pytest.raises(LiveHandError, match=rf"images/0\.exr {message}|images/0\.exr must be finite with {message}"):
        capture.read_linear(capture.views[0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["frames"][0].update(light=3), r"images/0\.exr: light must be one of 3 lights, got 3"),
        (lambda d: d["frames"][0].update(light=-1), "light must be one of"),
        (lambda d: d["frames"][0].update(light=True), "light must be one of"),
        (lambda d: d["frames"][0].update(light="key"), "light must be one of"),
        (lambda d: d["frames"][0].update(exposure=0), r"images/0\.exr: exposure must be a finite number above 0"),
        (lambda d: d["frames"][0].update(exposure="2"), "exposure must be"),
        (lambda d: d.update(lights={"0": 1}), "must have a list of lights"),
        (lambda d: d["lights"].__setitem__(1, []), r"lights\[1\] must be an object"),
        (lambda d: d["lights"][1].update(lamp=[]), r"lights\[1\] must have no other keys than .* got \['lamp'\]"),
        (lambda d: d["lights"][0]["lamps"][1].pop("rgb"), r"lights\[0\]: a lamp must have a kind and rgb"),
        (lambda d: d["lights"][0]["lamps"][1].update(power=3), r"lights\[0\]: a lamp must have no other keys"),
        (lambda d: d["lights"][0]["lamps"][1].update(kind="moon"), r"lights\[0\]: a lamp's kind must be one of"),
        (lambda d: d["lights"][0]["lamps"][1].update(rgb=[1, 2]), r"lights\[0\]: a lamp's rgb must be \[3\]"),
        (lambda d: d["lights"][0]["lamps"][1].update(rotation=np.full((3, 3), 1.0).tolist()), "must be a rotation"),
        (lambda d: d["lights"][0]["lamps"][1].update(cone_rad="wide"), "a lamp's cone_rad must be like"),
        (lambda d: d["lights"][0]["lamps"][1].update(casts_shadow=1), "a lamp's casts_shadow must be like True, got 1"),
        (lambda d: d["lights"][0]["lamps"][1].update(size_m="ab"), r"lights\[0\]: "),
        (
            lambda d: d["lights"][0].update(sky_path="lights/none.exr"),
            r"lights\[0\]: .*none\.exr must be a readable image",
        ),
        (lambda d: d["lights"][0].update(sky_path=3), "sky_path must be a file's name, got 3"),
        (lambda d: d["lights"][0].update(occluders=[[1, 2, 3]]), r"lights\[0\]: "),
        (lambda d: d["lights"][0].update(occluder_albedo=[[1, 0, 0]]), r"occluder_albedo must be \[2, 3\]"),
        (lambda d: d["lights"][0].update(occluder_albedo=[[2, 0, 0]] * 2), "occluder_albedo must be between"),
    ],
)
def test_faults_of_the_lights_are_named(capture, change, message):
    path = capture.folder / "transforms.json"
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    with pytest.raises(LiveHandError, match=message):
        load_capture(capture.folder)
