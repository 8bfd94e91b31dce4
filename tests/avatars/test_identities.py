"""Several people in one avatar."""

from dataclasses import replace

import pytest
import torch
from livehand.backend.avatars.avatar import PRESETS, new_avatar
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.avatars.identities import checked_names, identity_names, of_identity, with_identity
from livehand.backend.field.conditions import FieldInputs
from livehand.backend.records.errors import LiveHandError

NAMES = ("ann", "bo")


@pytest.fixture(scope="module")
def crowd(hand):
    config = PRESETS["paper"]
    config = replace(config, field=replace(config.field, identities=NAMES))
    avatar = new_avatar("crowd", hand.name, hand.sha256, config, seed=1)
    with torch.no_grad():
        avatar.field.codes += torch.tensor([[1.0], [-1.0]])
    return avatar


def asked(avatar, identity=0):
    generator = torch.Generator().manual_seed(0)
    uv, height = torch.rand(6, 2, generator=generator), torch.rand(6, generator=generator)
    view, theta = torch.rand(3, 3, generator=generator), torch.rand(48, generator=generator)
    inputs = FieldInputs.of_paper(uv, height, view, theta)._replace(identity=identity)
    return torch.cat([values.flatten() for values in avatar.field.ask(inputs, 2)]).detach()


def test_a_person_alone_is_what_the_network_shows_with_their_code(crowd):
    people = [of_identity(crowd, name) for name in NAMES]
    for index, person in enumerate(people):
        assert identity_names(person) == ()
        assert torch.allclose(asked(person), asked(crowd, index), atol=1e-5)
    assert not torch.allclose(asked(people[0]), asked(people[1]), atol=1e-2)


def test_the_mean_lies_between(crowd):
    mean = of_identity(crowd, "mean")
    with torch.no_grad():
        added = crowd.field.identity(crowd.field.codes.mean(0))
    assert torch.allclose(mean.field.position.bias, crowd.field.position.bias + added, atol=1e-6)


def test_one_more_person_begins_as_the_mean_and_changes_nobody(crowd):
    grown = with_identity(crowd, "cy")
    assert identity_names(grown) == (*NAMES, "cy")
    assert torch.equal(asked(grown, 1), asked(crowd, 1))
    assert torch.allclose(asked(grown, 2), asked(of_identity(crowd, "mean")), atol=1e-5)
    assert len(crowd.field.codes) == 2


def test_names_and_codes_are_kept_in_the_file(crowd, tmp_path):
    save_avatar(crowd, tmp_path / "crowd.safetensors")
    read = load_avatar(tmp_path / "crowd.safetensors")
    assert identity_names(read) == NAMES
    assert torch.allclose(read.field.codes, crowd.field.codes, atol=1e-3)
    save_avatar(of_identity(read, "bo"), tmp_path / "bo.safetensors")
    assert torch.allclose(asked(load_avatar(tmp_path / "bo.safetensors")), asked(crowd, 1), atol=2e-2)


def test_unknown_people_and_names_taken_twice_are_refused(crowd):
    with pytest.raises(LiveHandError, match="one of ann, bo or mean, got cy"):
        of_identity(crowd, "cy")
    with pytest.raises(LiveHandError, match="got 'bo'"):
        with_identity(crowd, "bo")
    alone = of_identity(crowd, "ann")
    for change in (of_identity, with_identity):
        with pytest.raises(LiveHandError, match="'ann'"):
            change(alone, "bo")
    for wrong in (("",), ("mean",), ("a", "a")):
        with pytest.raises(LiveHandError, match="must differ"):
            checked_names(wrong)
