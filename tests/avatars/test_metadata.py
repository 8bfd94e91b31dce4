"""The metadata of an avatar, read without torch."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.avatars.file import save_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.avatars.metadata import read_metadata
from livehand.backend.field.field import FieldConfig
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from safetensors.numpy import save_file

SMALL = AvatarConfig(FieldConfig(width=4, planes=((8, 2, 2),), relief=8), SuperResConfig(width=4, depth=1))
FIGURES = {"psnr_full": 31.54, "psnr_hand": 27.06, "ssim": 0.9123, "alpha_iou": 0.98765, "images": 7}
PLAN = {"poses": 99, "first_poses": 28, "size_px": [334, 512]}


@pytest.fixture
def file_of(tmp_path):
    def save(**changes):
        made = new_avatar("ada", "my_hand", "ab" * 32, SMALL)
        save_avatar(replace(made, **changes), tmp_path / "ada.safetensors")
        return tmp_path / "ada.safetensors"

    return save


def test_it_is_what_the_file_says(file_of):
    thumbnail = np.arange(64, dtype=np.uint8).reshape(4, 4, 4)
    path = file_of(
        provenance={"licence": "CC0", "capture": {"made_by": "livehand capture", "plan": PLAN}},
        metrics={"novel_pose": {**FIGURES, "psnr_full": 99.0}, "test": FIGURES},
        thumbnail=thumbnail,
    )
    metadata = read_metadata(path)
    assert (metadata.path, metadata.name, metadata.hand_name, metadata.hand_sha256) == (
        path,
        "ada",
        "my_hand",
        "ab" * 32,
    )
    assert metadata.licence == "CC0"
    assert metadata.figures == (
        "PSNR 31.5 dB, hand alone 27.1 dB",
        "SSIM 0.912, alpha IoU 0.988",
        "on 7 views of unseen poses and cameras",
    )
    assert metadata.made_from == "livehand capture: 28 poses, 334x512 px"
    np.testing.assert_array_equal(metadata.thumbnail, thumbnail)


def test_missing_entries_are_empty(file_of):
    metadata = read_metadata(file_of())
    assert (metadata.licence, metadata.figures, metadata.made_from, metadata.thumbnail) == ("", (), "", None)


def test_the_hardest_evaluated_split_is_shown(file_of):
    metadata = read_metadata(file_of(metrics={"novel_camera": FIGURES}, provenance={"capture": {"made_by": "my rig"}}))
    assert metadata.figures[-1] == "on 7 views of unseen cameras"
    assert metadata.made_from == "my rig"


def test_other_files_are_refused(tmp_path):
    other, text = tmp_path / "other.safetensors", tmp_path / "text.safetensors"
    save_file({"a": np.zeros(3)}, other)
    text.write_text("no tensors")
    for path in (other, text, tmp_path / "missing.safetensors"):
        with pytest.raises(LiveHandError, match="must be a LiveHand avatar"):
            read_metadata(path)
    save_file({"a": np.zeros(3)}, other, metadata={"livehand": json.dumps({"name": "x"})})
    with pytest.raises(LiveHandError, match="of this version"):
        read_metadata(other)


def test_torch_is_not_loaded():
    """Loading torch takes a second, which would delay the first drawing of a panel."""
    code = (
        "import sys; from pathlib import Path; from livehand.backend.avatars.metadata import read_metadata;"
        f"read_metadata(Path({str(shipped_avatar_path())!r})); assert 'torch' not in sys.modules"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
