"""InterHand2.6M's layout, written by hand: what the reader makes of it, checked against the data set's own formulas."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.capture.capture import load_capture
from livehand.backend.capture.check import check_capture
from livehand.backend.capture.importers.interhand import camera_of_image
from livehand.backend.capture.importers.interhand_capture import InterHandRequest, import_interhand
from livehand.backend.capture.masks.mask import MaskConfig
from livehand.backend.capture.masks.mask_capture import mask_capture
from livehand.backend.capture.split import load_split
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.hand.lbs import posed_arrays, posed_vertices
from livehand.backend.hand.model_file import builtin_hand_path, load_default_hand, load_hand_model, load_hands_mean
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.system.command import run_commands
from livehand.backend.training.views import TrainingViews
from livehand.livehand_blender.cli import COMMANDS
from PIL import Image
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.slow

SIZE = (33, 51)
COLOUR, STRETCHED, GREY = "400262", "400412", "410001"
FRAMES = (100, 103, 106, 109, 112)
UNFITTED, INTERACTING, LEFT, DOUBTFUL = 115, 118, 121, 124
MEAN = np.random.default_rng(7).normal(scale=0.2, size=(15, 3))


class DataSet:
    """A folder in InterHand2.6M's layout, kept as documents that a test may spoil before they are written."""

    def __init__(self, root):
        self.root, rng = root, np.random.default_rng(0)
        hand = load_default_hand()
        self.hand_file = root / "MANO_RIGHT.npz"
        with np.load(builtin_hand_path()) as arrays:
            np.savez(self.hand_file, **arrays, hands_mean=MEAN.ravel())
        self.cameras = {"campos": {}, "camrot": {}, "focal": {}, "princpt": {}}
        centre_mm = 1000 * (hand.joints[4] + [0.2, -0.1, 0.9])
        for name, axis_angle in ((COLOUR, [0.3, 0.1, 0]), (STRETCHED, [0.1, -0.7, 0.2]), (GREY, [-0.4, 0.5, 1])):
            camrot = Rotation.from_rotvec(axis_angle).as_matrix()
            self.cameras["camrot"][name] = camrot.tolist()
            self.cameras["campos"][name] = (centre_mm - camrot.T @ [3, -5, 700]).tolist()
            self.cameras["focal"][name] = [121.3, 120.1]
            self.cameras["princpt"][name] = [SIZE[0] / 2 + 1.3, SIZE[1] / 2 - 2.1]
        self.fits = {}
        for frame in (*FRAMES, INTERACTING, LEFT, DOUBTFUL):
            pose = np.r_[0.3, -0.2, 0.5, rng.normal(scale=0.2, size=45)]
            fit = {"pose": pose.tolist(), "shape": rng.normal(size=10).tolist()}
            self.fits[str(frame)] = {"right": {**fit, "trans": [0.21, -0.1, 0.88]}, "left": None}
        self.fits[str(UNFITTED)] = {"right": None, "left": None}
        self.images, self.annotations = [], []
        for frame in (*FRAMES, UNFITTED, INTERACTING, LEFT, DOUBTFUL):
            for camera in (COLOUR, STRETCHED, GREY):
                self.add(frame, camera)
        self.add(FRAMES[0], COLOUR, capture=1)

    def add(self, frame, camera, capture=0):
        number = 1000 - len(self.images)
        name = f"Capture{capture}/ROM0{frame % 2}_Fist/cam{camera}/image{frame}.jpg"
        size = {"width": SIZE[0], "height": SIZE[1]}
        about = {"capture": capture, "subject": 3, "seq_name": f"ROM0{frame % 2}_Fist", "camera": camera}
        self.images.append({"id": number, "file_name": name, **size, **about, "frame_idx": frame})
        kind = {INTERACTING: "interacting", LEFT: "left"}.get(frame, "right")
        known = {"hand_type": kind, "hand_type_valid": int(frame != DOUBTFUL), "joint_valid": [1] * 42}
        self.annotations.append({"id": number + 5, "image_id": number, "bbox": [1, 2, 3, 4.5], **known})
        path = self.root / "images/test" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        grey = np.random.default_rng(frame).integers(0, 255, (SIZE[1], SIZE[0]), np.uint8)
        image = Image.fromarray(grey) if camera == GREY else Image.fromarray(np.stack([grey] * 3, -1))
        image.resize(SIZE[::-1] if camera == STRETCHED else SIZE).save(path)

    def write(self):
        folder = self.root / "annotations/test"
        folder.mkdir(parents=True, exist_ok=True)
        documents = {
            "data": {"images": self.images, "annotations": self.annotations},
            "camera": {"1": {"campos": {}}, "0": self.cameras},
            "MANO_NeuralAnnot": {"1": {}, "0": self.fits},
        }
        for name, document in documents.items():
            (folder / f"InterHand2.6M_test_{name}.json").write_text(json.dumps(document))
        return InterHandRequest(self.root, self.root / "annotations", "test", 0, held_out_frames=2)


@pytest.fixture
def data_set(tmp_path):
    return DataSet(tmp_path / "InterHand")


@pytest.fixture(autouse=True)
def root(tmp_path):
    (tmp_path / "InterHand").mkdir()


def run(data_set, output, **changes):
    request = replace(data_set.write(), **changes)
    hand = load_hand_model(data_set.hand_file, "right")
    return import_interhand(request, hand, load_hands_mean(data_set.hand_file), output), hand


def test_projections_are_the_data_sets_own_in_millimetres(data_set, tmp_path):
    result, hand = run(data_set, tmp_path / "capture")
    capture = load_capture(tmp_path / "capture")
    assert len(capture.views) == 2 * len(FRAMES)
    for view in capture.views:
        frame, name = FRAMES[view.pose_index], (COLOUR, STRETCHED)[view.camera_index]
        assert view.file == f"images/Capture0/ROM0{frame % 2}_Fist/cam{name}/image{frame}.jpg"
        fit = data_set.fits[str(frame)]["right"]
        theta = np.array(fit["pose"]).reshape(16, 3) + np.r_[np.zeros((1, 3)), MEAN]
        vertices_mm = 1000 * posed_vertices(hand, HandPose(theta, np.array(fit["shape"]), np.array(fit["trans"])))
        camrot, campos, focal, princpt = (
            np.array(data_set.cameras[key][name]) for key in ("camrot", "campos", "focal", "princpt")
        )
        in_camera_mm = (camrot @ (vertices_mm - campos).T).T
        expected = focal * in_camera_mm[:, :2] / in_camera_mm[:, 2:] + princpt
        if name == STRETCHED:
            expected = expected * [SIZE[1] / SIZE[0], SIZE[0] / SIZE[1]]
        pixels, depth = view.camera.project(posed_vertices(hand, capture.poses[view.pose_index]))
        np.testing.assert_allclose(pixels, expected, atol=1e-8)
        np.testing.assert_allclose(depth, in_camera_mm[:, 2] / 1000, atol=1e-12)
        is_inside = ((pixels > 0) & (pixels < view.camera.size_px)).all(1)
        assert is_inside[hand.framed_vertices].mean() > 0.5  # the fixture is no empty truth
    assert result.capture.hand_sha256 == capture.hand_sha256 == hand.sha256


def test_only_fitted_frames_of_a_right_hand_in_colour_are_taken(data_set, tmp_path):
    result, _ = run(data_set, tmp_path / "capture")
    assert (result.grey_images, result.unfitted_frames) == (len(FRAMES) + 1, 1)
    assert {view.camera.size_px for view in result.capture.views} == {SIZE, SIZE[::-1]}
    view = result.capture.views[0]
    original = data_set.root / "images/test" / view.file.removeprefix("images/")
    assert (tmp_path / "capture" / view.file).read_bytes() == original.read_bytes()


def test_the_mean_is_added_to_the_fingers_alone(data_set, tmp_path):
    result, _ = run(data_set, tmp_path / "capture")
    written = np.array(data_set.fits[str(FRAMES[2])]["right"]["pose"]).reshape(16, 3)
    np.testing.assert_array_equal(result.capture.poses[2].theta[0], written[0])
    np.testing.assert_allclose(result.capture.poses[2].theta[1:] - written[1:], MEAN)


def test_the_last_frames_and_the_named_cameras_are_held_out(data_set, tmp_path):
    result, _ = run(data_set, tmp_path / "capture", held_out_cameras=[STRETCHED])
    for view in result.capture.views:
        new_pose, new_camera = view.pose_index >= 3, view.camera_index == 1
        names = {(0, 0): "train", (1, 0): "novel_pose", (0, 1): "novel_camera", (1, 1): "test"}
        assert view.split == names[new_pose, new_camera]
    split = load_split(tmp_path / "capture/split.json", "InterHand2.6M test/Capture0 right")
    assert (split.train_frames, split.held_out_frames) == (FRAMES[:3], FRAMES[3:])
    assert (split.train_cameras, split.held_out_cameras) == ((COLOUR,), (STRETCHED,))


def test_a_published_split_gives_the_same_capture_whatever_the_defaults(data_set, tmp_path):
    one, _ = run(data_set, tmp_path / "one", held_out_cameras=[STRETCHED])
    two, _ = run(data_set, tmp_path / "two", held_out_frames=1, split_file=tmp_path / "one/split.json")
    assert [(view.file, view.split) for view in one.capture.views] == [
        (view.file, view.split) for view in two.capture.views
    ]


def test_thinning_moves_no_frame_from_what_is_held_out_to_training(data_set, tmp_path):
    all_frames, _ = run(data_set, tmp_path / "all", held_out_cameras=[])
    fewer, _ = run(data_set, tmp_path / "fewer", held_out_cameras=[], every=2)
    split_of = {view.file: view.split for view in all_frames.capture.views}
    assert {view.file.rpartition("image")[2] for view in fewer.capture.views} == {"100.jpg", "106.jpg", "109.jpg"}
    assert all(view.split == split_of[view.file] for view in fewer.capture.views)


def test_sequences_and_cameras_can_be_chosen(data_set, tmp_path):
    result, _ = run(data_set, tmp_path / "a", sequences=["ROM00_Fist"], cameras=[COLOUR], held_out_frames=1)
    assert [view.file.rpartition("/")[2] for view in result.capture.views] == [
        "image100.jpg", "image106.jpg", "image112.jpg",
    ]  # fmt: skip
    with pytest.raises(LiveHandError, match="must have images of the requested sequences"):
        run(data_set, tmp_path / "b", sequences=["ROM99"])


@pytest.mark.parametrize("shape", ["mean", "median"])
def test_one_shape_for_all_frames_leaves_the_wrist_in_its_place(data_set, tmp_path, shape):
    with np.load(data_set.hand_file) as arrays:  # the built-in hand's wrist is the same in all shapes; MANO's is not
        shapedirs = arrays["shapedirs"] + np.array([[0.004], [-0.002], [0.001]])
        np.savez(data_set.hand_file, **{**arrays, "shapedirs": shapedirs})
    own, hand = run(data_set, tmp_path / "own")
    shared, _ = run(data_set, tmp_path / "shared", shape=shape)
    betas = np.array([pose.beta for pose in own.capture.poses])
    for before, after in zip(own.capture.poses, shared.capture.poses, strict=True):
        np.testing.assert_allclose(after.beta, getattr(np, shape)(betas, 0))
        wrists = [posed_arrays(hand, pose)[1][0] for pose in (before, after)]
        np.testing.assert_allclose(wrists[0], wrists[1], atol=1e-12)
        assert np.abs(after.transl - before.transl).max() > 1e-3


def test_older_layouts_are_found(data_set, tmp_path):
    request = data_set.write()
    (data_set.root / "old/all").mkdir(parents=True)
    (request.annotations / "test").rename(data_set.root / "old/all/test")
    hand = load_hand_model(data_set.hand_file, "right")
    result = import_interhand(replace(request, annotations=data_set.root / "old"), hand, MEAN, tmp_path / "capture")
    assert len(result.capture.views) == 10


def spoil_fit(data_set, key, value):
    data_set.fits[str(FRAMES[1])]["right"][key] = value


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda d: spoil_fit(d, "pose", [0.0] * 45), r"MANO_NeuralAnnot\.json: capture 0, frame 103: "),
        (lambda d: spoil_fit(d, "trans", [0, float("nan"), 0]), r"NeuralAnnot\.json must be whole, well-formed JSON"),
        (lambda d: spoil_fit(d, "shape", [0.0] * 9), r"frame 103: beta must be \[10\]"),
        (lambda d: d.fits.update({"x": {}}), r"MANO_NeuralAnnot\.json: capture 0 must hold"),
        (lambda d: d.cameras.pop("focal"), r"camera\.json: capture 0 must hold campos, camrot, focal"),
        (lambda d: d.cameras["campos"].update({COLOUR: [1, 2]}), r"camera\.json: capture 0 must hold"),
        (lambda d: d.cameras["campos"].pop(COLOUR), "camera 400262 must be calibrated"),
        (lambda d: d.cameras["camrot"].update({COLOUR: np.diag([1, 1, -1.0]).tolist()}), r"image100\.jpg: .*rotation"),
        (lambda d: d.cameras["princpt"].update({COLOUR: [0, 0]}), "principal point must lie near the centre"),
        (
            lambda d: d.cameras["focal"].update({COLOUR: [1, float("inf")]}),
            r"camera\.json must be whole, well-formed JSON",
        ),
        (lambda d: d.images[0].update(file_name="../../secret.jpg"), "must lie inside the data set"),
        (lambda d: d.images[0].update(file_name="/etc/passwd"), "must lie inside the data set"),
        (lambda d: d.images[0].pop("camera"), r"data\.json: an entry of images is malformed"),
        (lambda d: d.images[0].update(frame_idx="first"), r"data\.json: an entry of images is malformed"),
        (lambda d: d.annotations.__setitem__(0, None), r"data\.json: an entry of annotations is malformed"),
        (lambda d: d.annotations.clear(), "must have colour images of a single right hand in capture 0, got none"),
    ],
)
def test_malformed_annotations_are_named_and_leave_nothing(data_set, tmp_path, spoil, message):
    spoil(data_set)
    with pytest.raises(LiveHandError, match=message):
        run(data_set, tmp_path / "capture")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["InterHand"]


def test_bad_images_are_all_named_and_leave_nothing(data_set, tmp_path):
    folder = data_set.root / "images/test/Capture0/ROM00_Fist" / f"cam{COLOUR}"
    (folder / "image100.jpg").unlink()
    (folder / "image106.jpg").write_bytes(b"no picture")
    Image.new("L", SIZE).save(folder / "image112.jpg")
    with pytest.raises(LiveHandError, match="has 3 faults") as caught:
        run(data_set, tmp_path / "capture")
    for fault in (r"image100.jpg must be a readable", r"image106.jpg must be a readable", "image112.jpg must be a col"):
        assert fault in str(caught.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["InterHand"]


def test_an_annotation_that_is_cut_short_or_missing_is_named(data_set, tmp_path):
    request = data_set.write()
    hand = load_hand_model(data_set.hand_file, "right")
    for name in ("camera", "MANO_NeuralAnnot", "data"):
        path = request.annotations / f"test/InterHand2.6M_test_{name}.json"
        text = path.read_text()
        for spoilt in (text[: len(text) // 2], "", "[" * 100_000, text.replace("{", "{,", 1), "\udcff"):
            path.write_text(spoilt, errors="surrogateescape")
            with pytest.raises(LiveHandError, match=rf"{name}\.json"):
                import_interhand(request, hand, MEAN, tmp_path / "capture")
        path.unlink()
        with pytest.raises(LiveHandError, match=rf"no InterHand2\.6M_test_{name}\.json in"):
            import_interhand(request, hand, MEAN, tmp_path / "capture")
        path.write_text(text)
    assert not (tmp_path / "capture").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"held_out_frames": 5}, "must leave frames and cameras to train on"),
        ({"held_out_cameras": [COLOUR, STRETCHED]}, "must leave frames and cameras to train on"),
        ({"held_out_cameras": ["400999"]}, r"held-out cameras must be among .*got \['400999'\]"),
        ({"capture": 9}, "must hold '9'"),
    ],
)
def test_requests_that_cannot_be_met_are_refused(data_set, tmp_path, changes, message):
    with pytest.raises(LiveHandError, match=message):
        run(data_set, tmp_path / "capture", **changes)
    assert not (tmp_path / "capture").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(source="InterHand2.6M test/Capture1 right"), "must be of InterHand2.6M test/Capture0"),
        (lambda d: d.update(format="other"), "must be a split file"),
        (lambda d: d.pop("train_frames"), "must be a split file"),
        (lambda d: d["train_frames"].append(d["held_out_frames"][0]), "must not be trained on"),
        (lambda d: d["train_frames"].append(7), r"got 1 others, such as \[7\]"),
    ],
)
def test_splits_that_do_not_fit_are_refused(data_set, tmp_path, change, message):
    run(data_set, tmp_path / "one")
    document = json.loads((tmp_path / "one/split.json").read_text())
    change(document)
    (tmp_path / "other.json").write_text(json.dumps(document))
    with pytest.raises(LiveHandError, match=message):
        run(data_set, tmp_path / "two", split_file=tmp_path / "other.json")


def test_an_import_goes_on_where_it_stopped_and_takes_no_other_place(data_set, tmp_path):
    run(data_set, tmp_path / "capture")
    partial = tmp_path / "capture.partial"
    (tmp_path / "capture").rename(partial)
    missing, kept = sorted(partial.rglob("*.jpg"))[:2]
    missing.unlink()
    kept.write_bytes(b"kept")
    with pytest.raises(LiveHandError, match="got another unfinished one"):
        run(data_set, tmp_path / "capture", shape="mean")
    run(data_set, tmp_path / "capture")
    assert not partial.exists()
    assert (tmp_path / "capture" / kept.relative_to(partial)).read_bytes() == b"kept"
    assert (tmp_path / "capture" / missing.relative_to(partial)).is_file()
    with pytest.raises(LiveHandError, match="needs an empty folder"):
        run(data_set, tmp_path / "capture")


def test_an_upright_camera_is_not_stretched():
    K = np.array([[1200.0, 0, 160], [0, 1190, 260], [0, 0, 1]])
    np.testing.assert_array_equal(camera_of_image(K, np.eye(4), (334, 512)).K, K)


def test_an_imported_capture_can_be_trained_on_once_it_has_masks(data_set, tmp_path):
    result, hand = run(data_set, tmp_path / "capture")
    with pytest.raises(LiveHandError, match=r"has 10 faults:(?s:.*)must have alpha .* `livehand mask` makes masks"):
        check_capture(result.capture, hand)
    mask_capture(tmp_path / "capture", hand, MaskConfig())
    capture = load_capture(tmp_path / "capture")
    check_capture(capture, hand)
    views = TrainingViews(capture, capture.of_split("train"), hand, SamplerConfig(4, 0.003), torch.device("cpu"), 0)
    assert len(views) == 6
    for index, view in enumerate(views.views):  # both of square pixels and of stretched ones
        target = views.get(index, 0).target
        assert target[3].sum() == pytest.approx(capture.read_image(view)[..., 3].sum(), rel=1e-5)


def test_the_command_imports(data_set, tmp_path, capsys):
    data_set.write()
    arguments = ["import-interhand", str(data_set.root), "-o", str(tmp_path / "capture"), "--capture", "0"]
    arguments += ["--hand", str(data_set.hand_file), "--held-out-frames", "2", "--held-out-cameras", STRETCHED]
    assert run_commands("livehand", "", COMMANDS, [*arguments, "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (result["images"], result["poses"], result["grey_images"]) == (10, 5, 6)
    assert len(load_capture(tmp_path / "capture").of_split("test")) == 2
    assert run_commands("livehand", "", COMMANDS, arguments) == 1
    assert "needs an empty folder" in capsys.readouterr().err


def test_a_hand_without_a_mean_pose_is_refused(tmp_path):
    with pytest.raises(LiveHandError, match="must hold hands_mean"):
        load_hands_mean(builtin_hand_path())
