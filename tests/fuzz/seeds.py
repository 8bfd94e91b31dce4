"""A small sound file of every kind that is read, and the reader of each."""

import argparse
import importlib.util
import io
import json
import pickle
import struct
import zlib
from dataclasses import dataclass, replace
from itertools import islice, pairwise
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from livehand.backend.avatars import file as avatar_files
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.avatars.metadata import HEADER_KEY, read_metadata
from livehand.backend.batch.frame_file import is_finished
from livehand.backend.batch.frame_records import joined_records, kept_records, read_records, record_of
from livehand.backend.batch.frame_selection import parse_chunk, parse_frames
from livehand.backend.batch.leases import read_owner, signature
from livehand.backend.batch.shot_version import ShotVersion, others_message
from livehand.backend.capture.capture import Capture, CaptureView, load_capture, save_capture_index
from livehand.backend.capture.exr import read_exr, write_exr
from livehand.backend.capture.importers.interhand import read_cameras, read_fits, read_images
from livehand.backend.capture.importers.transforms import read_pose_table
from livehand.backend.capture.importers.transforms_capture import import_transforms
from livehand.backend.capture.person import Person
from livehand.backend.capture.picture import read_mask, read_picture
from livehand.backend.capture.split import FrameSplit, load_split, split_document
from livehand.backend.commands.inspect import inspect
from livehand.backend.commands.render_motion import parse_picture_camera
from livehand.backend.field.field import FieldConfig
from livehand.backend.hand.model_file import builtin_hand_path, load_default_hand, load_hand_model, load_hands_mean
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.motion.files.import_options import ImportOptions, motion_and_warning
from livehand.backend.motion.files.open_files import open_motion_file
from livehand.backend.motion.files.summary import file_summary
from livehand.backend.motion.landmarks import landmark_file
from livehand.backend.motion.landmarks.fit import side_errors
from livehand.backend.records.camera import Camera
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.research.baselines.weights_file import load_network, save_method
from livehand.backend.research.comparison.grid import load_pictures, save_pictures
from livehand.backend.rigs.bvh_positions import with_offsets
from livehand.backend.surface.base_surface import surface_of_person
from livehand.backend.surface.surface_file import read_surface, write_surface
from livehand.backend.system.command import parse_size_px
from livehand.backend.system.readers import read_json
from livehand.backend.tracking import sighted_take, video
from livehand.backend.tracking.video import FilmClock
from livehand.backend.training.checkpoint import Progress, TrainState, load_checkpoint, save_checkpoint
from livehand.livehand_blender.render.command import parse_formats
from mutation import changed_array, mutated_bytes, mutated_json, mutated_npz
from PIL import Image
from safetensors import safe_open
from safetensors.torch import save

HAND = load_default_hand()
_POINTS = HAND.v_template[:: len(HAND.v_template) // 21][:21]
FIT = {"pose": [0.1] * 48, "shape": [0.0] * 10, "trans": [0.0, 0, 1]}
_MOST_FITTED = 20


@dataclass(frozen=True)
class Seed:
    """A file, what reads it, and how it is changed besides its bytes."""

    reader: str
    name: str
    raw: bytes
    read: Any
    change: Any = None

    def mutated(self, rng):
        """Another file."""
        if self.change is not None and rng.random() < 0.7:
            try:
                raw = self.change(self.raw, rng)
            except Exception:  # changes that cannot be written to a file
                return mutated_bytes(self.raw, rng)
            return mutated_bytes(raw, rng) if rng.random() < 0.1 else raw
        return mutated_bytes(self.raw, rng)


def read_motion(path):
    """As import and inspect do; of landmarks, which take most of the time, one file in ten is fitted."""
    is_fitted = zlib.crc32(path.read_bytes()) % 10 == 0
    with patch.object(landmark_file, "side_errors", side_errors if is_fitted else _unfitted):
        file = open_motion_file(path)
    file_summary(file)
    if not isinstance(file, landmark_file.LandmarkFile) or (is_fitted and len(file.points) <= _MOST_FITTED):
        motion_and_warning(file, ImportOptions(), HAND, None)


def _unfitted(points, model):
    raise LiveHandError("not fitted")


def npz(**arrays):
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def npy(value):
    file = io.BytesIO()
    np.save(file, value, allow_pickle=True)
    return file.getvalue()


def changed_pickle(raw, rng):
    content = pickle.loads(raw)
    if isinstance(content, dict):
        key = list(content)[rng.integers(len(content))]
        value = content[key]
        content[key] = changed_array(value, rng) if isinstance(value, np.ndarray) else [value] * int(rng.integers(3))
    else:
        content = content + [content] * int(rng.integers(3))
    return pickle.dumps(content, protocol=int(rng.integers(6)))


def motion_seeds():
    rng = np.random.default_rng(0)
    poses = rng.normal(size=(6, 48)) * 0.3
    eye = np.broadcast_to(np.eye(3), (3, 15, 3, 3))
    result = {
        "worldLandmarks": [[dict(zip("xyz", point, strict=True)) for point in _POINTS.tolist()]],
        "landmarks": [[{"x": 0.5, "y": 0.5, "z": 0.1}] * 21],
        "handedness": [[{"score": 0.9, "index": 0, "categoryName": "Left", "displayName": "Left"}]],
    }
    joints = {f"{f}-{j}": p for f, j, p in _webxr()}
    rows = "\n".join(f"{t},Left,{k},{x},{y},{z}" for t in range(3) for k, (x, y, z) in enumerate(_POINTS.tolist()))
    wide = ",".join(f"{axis}{k}" for k in range(21) for axis in "xyz")
    numbers = "\n".join([",".join(map(str, _POINTS.ravel()))] * 3)
    ho3d = {"handPose": np.ones(48), "handTrans": np.zeros(3), "handBeta": np.zeros(10), "camMat": np.eye(3)}
    hamer = {"hand_pose": eye, "global_orient": eye[:, :1], "betas": np.zeros((3, 10)), "right": np.array([1, 0, 1])}
    smplx = {"global_orient": np.zeros((4, 3)), "body_pose": np.zeros((4, 63)), "left_hand_pose": np.zeros((4, 45))}
    arctic = {"right": {"rot": np.zeros((3, 3)), "pose": np.zeros((3, 45)), "trans": np.zeros((3, 3))}}
    texts = {
        "tasks.json": {"fps": 30, "frames": [result, None, result]},
        "plain.json": [_POINTS.tolist(), None, _POINTS.tolist()],
        "webxr.json": [{"handedness": "left", "joints": joints}] * 3,
        "raw.json": poses.tolist(),
        "freihand.json": [[[0.1] * 61]] * 4,
        "x_NeuralAnnot.json": {"0": {"3": {"right": FIT, "left": None}}},
        "wilor.json": _wilor_frames(),
        "leap.json": {"frames": [_leap_frame()] * 3},
        "rokoko.json": [{"scene": {"actors": [{"body": _rokoko_body()}]}}] * 3,
        "hot3d.json": {"right": {"mano_pose": {"thetas": [0.1] * 15, "wrist_xform": [0.1] * 6}}},
    }
    yield from (
        Seed("poses, json", name, json.dumps(text).encode(), read_motion, mutated_json) for name, text in texts.items()
    )
    arrays = {
        "own.npz": npz(theta=poses.reshape(6, 16, 3), transl=np.zeros((6, 3)), fps=24.0, side="left"),
        "amass.npz": npz(poses=np.zeros((5, 156)), mocap_framerate=120.0),
        "smplx.npz": npz(**smplx),
        "dexycb.npz": npz(pose_m=np.ones((1, 51))),
        "ho3d.npz": npz(**ho3d),
        "hamer.npz": npz(**hamer),
        "wilor.npz": npz(
            hand_pose=np.zeros((3, 15, 3)), global_orient=np.zeros((3, 1, 3)), is_right=np.array([0, 1, 0])
        ),
        "beat2.npz": npz(poses=np.zeros((5, 165)), expressions=np.zeros(5), model="smplx2020"),
        "parts.npz": npz(root_orient=np.zeros((4, 3)), pose_body=np.zeros((4, 63)), pose_hand=np.zeros((4, 90))),
        "take.npz": npz(**_take()),
        "landmarks.npz": npz(landmarks=np.stack([_POINTS] * 3), handedness="Right", fps=25),
    }
    yield from (Seed("poses, npz", name, raw, read_motion, mutated_npz) for name, raw in arrays.items())
    for name, content in (("ho3d.pkl", ho3d), ("list.pkl", [_POINTS] * 3), ("hamer.pkl", hamer)):
        yield Seed("poses, pkl", name, pickle.dumps(content, protocol=2), read_motion, changed_pickle)
    yield Seed(
        "poses, pkl", "wilor.pkl", pickle.dumps(_wilor_frames(np.array), protocol=4), read_motion, changed_pickle
    )
    params = {"global_orient": np.zeros((3, 3)), "fullpose": np.zeros((3, 45)), "transl": np.zeros((3, 3))}
    grab = npz(rhand=np.array({"params": params}, object), framerate=120.0)
    yield Seed("poses, npz", "grab.npz", grab, read_motion)
    yield Seed("poses, npy", "a.mano.npy", npy(arctic), read_motion)
    yield Seed("poses, npy", "raw.npy", npy(poses), read_motion)
    yield Seed("poses, csv", "wide.csv", f"{wide}\n{numbers}".encode(), read_motion)
    yield Seed("poses, csv", "long.csv", f"frame,handedness,landmark,x,y,z\n{rows}".encode(), read_motion)
    yield Seed("poses, csv", "bare.csv", numbers.encode(), read_motion)
    logged = "\n".join(
        f"12:00:0{t},Left,{k},{x},{y},{z}" for t in range(3) for k, (x, y, z) in enumerate(_POINTS.tolist())
    )
    header = "Time,Hand,Joint,Position_X,Position_Y,Position_Z"
    yield Seed("poses, csv", "logged.csv", f"{header}\n{logged}".encode(), read_motion)
    line = {"timestamp_ns": 0, "hand_poses": {"1": {"pose": [0.1] * 15, "wrist_xform": _WRIST, "betas": [0.0] * 10}}}
    lines = [json.dumps(line | {"timestamp_ns": 33_000_000 * t}) for t in range(3)]
    yield Seed("poses, jsonl", "hot3d.jsonl", "\n".join(lines).encode(), read_motion)
    yield Seed("bvh", "take.bvh", _BVH.encode(), lambda path: with_offsets(path.read_text(errors="replace")))


_WRIST = {"q_wxyz": [1.0, 0, 0, 0], "t_xyz": [0.0, 0, 1]}
_BVH = """HIERARCHY
ROOT Hips
{
 OFFSET 0 90 0
 CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
 JOINT Hand
 {
  OFFSET -4 3 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
 }
}
MOTION
Frames: 2
Frame Time: 0.0333
0 90 0 0 0 0 0 0 0 20 0 0
0 90 0 0 0 0 0 0 0 20 0 0
"""


def _wilor_frames(spell=list):
    pose = {"hand_pose": spell([[[0.1] * 3] * 15]), "global_orient": spell([[[0.1] * 3]]), "betas": spell([[0.0] * 10])}
    return [[{"is_right": 0.0, "wilor_preds": pose}], [], [{"is_right": 0.0, "wilor_preds": pose}]]


def _leap_frame():
    ends = [_POINTS[:1], *(_POINTS[1 + 4 * k : 5 + 4 * k] for k in range(5))]
    fingers = [
        {
            "type": k,
            "bones": [
                {"prev_joint": start, "next_joint": end}
                for start, end in pairwise([*ends[0].tolist(), *ends[k + 1].tolist()])
            ],
        }
        for k in range(5)
    ]
    return {"hands": [{"type": "right", "fingers": fingers}]}


def _rokoko_body():
    names = [
        "Hand",
        *(
            f + p
            for f in ("Thumb", "Index", "Middle", "Ring", "Little")
            for p in ("Proximal", "Medial", "Distal", "Tip")
        ),
    ]
    points = (dict(zip("xyz", point, strict=True)) for point in _POINTS.tolist())
    return {f"left{name}": {"position": point} for name, point in zip(names, points, strict=True)}


def _take():
    points = 320 + 900 * _POINTS[None, :, [0, 2]]
    hand = {"right_frames": np.arange(4), "right_px": np.repeat(points, 4, 0), "right_world": np.stack([_POINTS] * 4)}
    return {"size_px": np.array([640, 480]), "focal_px": 600.0, "times": np.arange(4) / 30, "fps": 30.0, **hand}


def _webxr():
    points = ["metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip"]
    for k, finger in enumerate(("index-finger", "middle-finger", "ring-finger", "pinky-finger")):
        yield from ((finger, place, _POINTS[5 + 4 * k - 1 + j].tolist()) for j, place in enumerate(points))
    yield from (("thumb", place, _POINTS[1].tolist()) for place in points if "intermediate" not in place)
    yield "wrist", "", _POINTS[0].tolist()


def hand_seeds():
    with np.load(builtin_hand_path()) as archive:
        arrays = {key: np.asarray(archive[key]) for key in archive.files}
    raw = npz(**arrays)
    yield Seed("hand model, npz", "hand.npz", raw, load_hand_model, mutated_npz)
    yield Seed(
        "hand model, pkl",
        "hand.pkl",
        pickle.dumps({"v_template": np.zeros((9, 3))}, 2),
        load_hand_model,
        changed_pickle,
    )
    yield Seed("hand model, npz", "mean.npz", npz(hands_mean=np.zeros(45)), load_hands_mean, mutated_npz)


def changed_header(raw, rng):
    """An avatar whose header is changed and signed anew."""
    length = struct.unpack("<Q", raw[:8])[0]
    header = json.loads(json.loads(raw[8 : 8 + length])["__metadata__"][HEADER_KEY])
    header.pop("checksum")
    header = json.loads(mutated_json(json.dumps(header).encode(), rng)) if rng.random() < 0.98 else [header]
    tensors = _changed_tensors(_tensors(raw), rng)
    if isinstance(header, dict):
        try:
            header["checksum"] = avatar_files._checksum(header, tensors)
        except (TypeError, ValueError):
            pass
    return save(tensors, metadata={HEADER_KEY: json.dumps(header)})


def _changed_tensors(tensors, rng):
    """The same in seven of ten cases; else one has another type or shape, is not finite, or is missing."""
    key, kind = list(tensors)[rng.integers(len(tensors))], rng.integers(20)
    if kind < 3:
        tensors[key] = tensors[key].to((torch.bfloat16, torch.float64, torch.int8)[kind])
    elif kind == 3:
        tensors[key] = tensors[key].reshape(-1)[: int(rng.integers(3))].clone()
    elif kind == 4 and tensors[key].is_floating_point() and tensors[key].numel():
        tensors[key].view(-1)[0] = float("nan")
    elif kind == 5:
        del tensors[key]
    return tensors


def _tensors(raw):
    path = Path("avatar.fuzz")
    path.write_bytes(raw)
    with safe_open(path, framework="pt") as archive:
        return {key: archive.get_tensor(key).clone() for key in archive.keys()}


def avatar_seeds():
    """One with baked light, one with byte planes that shares the base surface, one that has arrays of its own."""
    baked = FieldConfig(width=8, density_width=4, planes=((4, 1, 2),), relief=4)
    config = AvatarConfig(baked, SuperResConfig(width=4, depth=1))
    lit = AvatarConfig(replace(baked, light="linear"), SuperResConfig(kind="lit", width=4, depth=1))
    shared = surface_of_person(Person(melanin=0.5), HAND.sha256)
    for avatar_config, surface in ((config, None), (lit, shared), (lit, replace(shared, arrays=_own_arrays()))):
        made = new_avatar("a", HAND.name, HAND.sha256, avatar_config)
        avatar_files.save_avatar(replace(made, surface=surface), Path("seed.safetensors"))
        raw = Path("seed.safetensors").read_bytes()
        yield Seed("avatar", "a.safetensors", raw, read_avatar_and_surface, changed_header)
        yield Seed("avatar, metadata", "a.safetensors", raw, read_metadata, changed_header)
    for surface in (shared, replace(shared, arrays=_own_arrays())):
        write_surface(Path("surface.npz"), surface)
        yield Seed("surface", "surface.npz", Path("surface.npz").read_bytes(), read_surface, mutated_npz)


def read_avatar_and_surface(path):
    """As a renderer does, but for the base's arrays, which are the same in every file."""
    avatar = avatar_files.load_avatar(path)
    if avatar.surface is not None:
        inspect(path)


def _own_arrays():
    rng = np.random.default_rng(0)
    maps = {f"fine/{name}": rng.integers(-9, 9, (64, 64)).astype(np.int8) for name in ("relief", "dorsal")}
    forms = {"form/joint": np.arange(3, dtype=np.int8), "form/range_deg": np.float32([[0, 9], [9, 20], [0, -9]])}
    return {**maps, **forms, "confidence": rng.integers(0, 255, (8, 8)).astype(np.uint8)}


def capture_seeds():
    camera = Camera(np.array([[9.0, 0, 4], [0, 9, 4], [0, 0, 1]]), np.eye(4), (8, 8))
    Path("capture").mkdir()
    pose = HandPose(np.zeros((16, 3)), np.zeros(10), np.zeros(3))
    capture = Capture(Path("capture"), HAND.sha256, {}, (pose,), (CaptureView("a.png", camera, 0, 0, "train"),))
    save_capture_index(capture)
    Image.new("RGBA", (8, 8), (9, 9, 9, 99)).save("capture/a.png")
    index, poses = (Path("capture", name).read_bytes() for name in ("transforms.json", "poses.npz"))
    png = Path("capture/a.png").read_bytes()

    def read(path):
        found = load_capture(path.parent)
        for view in found.views[:3]:
            found.read_linear(view)

    beside = {"transforms.json": index, "poses.npz": poses, "a.png": png}
    yield Seed("capture", "transforms.json", index, _beside(beside, read), mutated_json)
    yield Seed("capture", "poses.npz", poses, _beside(beside, read), mutated_npz)
    yield Seed("capture", "a.png", png, _beside(beside, read))
    frame = {"file_path": "a.png", "mask_path": "a.png", "transform_matrix": np.eye(4).tolist(), "pose_index": 0}
    transforms = {
        "camera_angle_x": 0.8,
        "frames": [frame, {**frame, "light": {"lamps": [{"kind": "sun", "rgb": [1, 1, 1]}]}}],
    }
    text = json.dumps(transforms).encode()

    def import_one(path):
        table = read_pose_table(path.parent / "poses.npz")
        import_transforms(path.parent / "transforms.json", table, HAND, path.parent / "out")

    yield Seed(
        "transforms", "transforms.json", text, _beside({**beside, "transforms.json": text}, import_one), mutated_json
    )
    yield Seed("transforms", "poses.npz", poses, _beside({**beside, "transforms.json": text}, import_one), mutated_npz)
    split = FrameSplit("x", (1, 2), (3,), ("a",), ("b",))
    yield Seed("split", "split.json", split_document(split).encode(), lambda path: load_split(path, "x"), mutated_json)
    yield from _interhand_seeds()


def _interhand_seeds():
    entry = {"id": 1, "file_name": "a.jpg", "capture": 0, "camera": "cam400002", "frame_idx": 3, "seq_name": "s"}
    annotation = {"image_id": 1, "hand_type": "right", "hand_type_valid": [1]}
    camera = {
        "campos": {"1": [0, 0, 0]},
        "camrot": {"1": np.eye(3).tolist()},
        "focal": {"1": [9, 9]},
        "princpt": {"1": [4, 4]},
    }
    for name, document, read in (
        ("data", {"images": [entry], "annotations": [annotation]}, lambda path: read_images(path, 0)),
        ("camera", {"0": camera}, lambda path: read_cameras(path, 0)),
        ("fits", {"0": {"3": {"right": FIT, "left": None}}}, lambda path: read_fits(path, 0, "right")),
    ):
        yield Seed("interhand", f"{name}.json", json.dumps(document).encode(), read, mutated_json)


def _beside(files, read):
    """A reader of a file among others that are sound."""

    def read_all(path):
        for name, raw in files.items():
            if name != path.name:
                (path.parent / name).write_bytes(raw)
        read(path)

    return read_all


def picture_seeds():
    for suffix, mode in ((".png", "RGBA"), (".jpg", "RGB"), (".webp", "RGBA"), (".tif", "LA"), (".bmp", "RGB")):
        file = io.BytesIO()
        Image.new(mode, (8, 8)).save(file, Image.registered_extensions()[suffix])
        yield Seed("picture", f"a{suffix}", file.getvalue(), lambda path: read_picture(path, "RGBA", (8, 8)))
        yield Seed("mask", f"a{suffix}", file.getvalue(), lambda path: read_mask(path, (8, 8)))
    write_exr(Path("a.exr"), {name: np.ones((20, 8), np.float16) for name in "RGBA"})
    yield Seed("exr", "a.exr", Path("a.exr").read_bytes(), read_exr)


def own_file_seeds():
    """What LiveHand writes for itself: leases, frames, checkpoints, fitted methods, pictures of a comparison."""
    yield Seed("lease", "a.claim", signature().encode(), read_owner, mutated_json)
    for seed in picture_seeds():
        if seed.name in ("a.png", "a.exr") and seed.reader != "mask":
            yield Seed("frame", seed.name, seed.raw, lambda path: is_finished(path, (8, 8)))
    module = torch.nn.Linear(2, 2)
    state = TrainState(module, torch.nn.Linear(2, 2), torch.optim.Adam(module.parameters()))
    save_checkpoint(Path("a.checkpoint"), state, Progress(7), "run")
    raw = Path("a.checkpoint").read_bytes()
    yield Seed("checkpoint", "a.checkpoint", raw, lambda path: load_checkpoint(path, state, "run"), _unsigned)
    save_method(Path(), "fuzz", module.state_dict(), {"size": 3})
    raw = Path("method.safetensors").read_bytes()
    yield Seed(
        "method", "method.safetensors", raw, lambda path: load_network(path.parent, "fuzz", module), _other_facts
    )
    save_pictures([(np.zeros((4, 4, 4)), np.ones((4, 4, 4)))], Path("pictures.npz"))
    yield Seed("comparison", "pictures.npz", Path("pictures.npz").read_bytes(), load_pictures, mutated_npz)


def record_seeds():
    """What a resumed run reads of frames that stay."""
    version = ShotVersion("1", "4.5", "5407", {"/a.png": "51"}, frozenset("a"), frozenset("h"), (8, 6), {"d": "cpu"})
    new = {"frame": 1, "formats": ["png"], "version": version.to_record()}
    record = joined_records([{**new, "formats": ["exr"], "hands": [{"side": "left"}]}], new)

    def read(path):
        records = read_records(path, ("exr", "png"))
        others_message(version.differences(record_of(records, name)) for name in ("exr", "png"))
        json.dumps(joined_records(kept_records(records, ["exr"]), new))

    yield Seed("record", "wave_0001.json", json.dumps(record).encode(), read, mutated_json)


def film_seeds():
    """Films, and the times that one gives its frames."""
    times = json.dumps([0, 0.04, 0.08, 95443.7, 95443.74, None]).encode()
    yield Seed("film clock", "times.json", times, _read_times, mutated_json)
    if importlib.util.find_spec("av") is None:
        return
    import av

    for name in ("film.mkv", "film.mp4", "film.ts"):
        with av.open(name, "w") as container:
            stream = container.add_stream("mpeg4", rate=30)
            stream.width, stream.height, stream.pix_fmt = 16, 16, "yuv420p"
            for _ in range(4):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((16, 16, 3), np.uint8), "rgb24")))
            container.mux(stream.encode(None))
        yield Seed("film", name, Path(name).read_bytes(), _read_film)


def _read_times(path):
    given = read_json(path)
    given = given if isinstance(given, list) else []
    clock = FilmClock(25.0)
    got = [clock.time_s(one) for one in given if one is None or (isinstance(one, int | float) and abs(one) < 1e12)]
    assert all(before < after for before, after in pairwise([-1.0, *got]))


def _read_film(path):
    with patch.object(video, "warn"), patch.object(sighted_take, "warn"):
        for _ in islice(sighted_take.frames_of_film(video.open_video(path)), 20):
            pass


def _unsigned(raw, rng):
    """A checkpoint as of the versions without checksums, with other progress or other tensors."""
    tensors = _changed_tensors(_tensors(raw), rng)
    progress = mutated_json(b'{"step": 7, "seconds": 1.5, "skipped": 0}', rng).decode()
    return save(tensors, metadata={"progress": progress, "run": "run"})


def _other_facts(raw, rng):
    facts = mutated_json(b'{"kind": "fuzz", "size": 3}', rng).decode()
    return save(_changed_tensors(_tensors(raw), rng), metadata={"livehand_method": facts})


def argument_seeds():
    """Texts of the command line."""
    texts = {
        "frames": ("1-24,30", parse_frames),
        "chunk": ("2/8", parse_chunk),
        "size": ("334x512", parse_size_px),
        "picture": ("1280x720@60", parse_picture_camera),
        "format": ("exr,png", parse_formats),
    }
    for name, (text, parse) in texts.items():
        yield Seed("arguments", name, text.encode(), _parsed_as(name, parse))


def _parsed_as(name, parse):
    parser = argparse.ArgumentParser(exit_on_error=False)
    parser.add_argument(f"--{name}", type=parse)

    def read(path):
        try:
            parser.parse_args([f"--{name}={path.read_bytes().decode(errors='surrogateescape')}"])
        except argparse.ArgumentError as error:
            raise LiveHandError(str(error)) from error

    return read


def all_seeds():
    """Every seed; those of poses and hands are also inspected. Written beside the working directory's cases."""
    seeds = [*motion_seeds(), *hand_seeds(), *avatar_seeds(), *capture_seeds(), *picture_seeds()]
    seeds += [*own_file_seeds(), *record_seeds(), *film_seeds(), *argument_seeds()]
    of_its_own = ("interhand", "method", "comparison", "record", "film clock")
    readable = (".npz", ".pkl", ".json", ".safetensors", ".npy", ".csv")
    inspected = [
        Seed("inspect", seed.name, seed.raw, inspect, seed.change)
        for seed in seeds
        if seed.name.endswith(readable) and seed.reader not in of_its_own
    ]
    return seeds + inspected
