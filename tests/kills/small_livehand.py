"""The `livehand` program with small networks, surfaces and textures, and a checkpoint every five steps.

KILLS_PLACE in the environment names the container in which it seems to run, where leases live for seconds only.
"""

import os
from dataclasses import replace
from functools import partial
from unittest.mock import patch

STALE_S = 3.0


def main():
    from livehand.livehand_blender.__main__ import program

    for change in (*_training(), *_comparison(), *_capture(), *_person(), *_leases()):
        change.start()
    program()


def _training():
    from livehand.backend.avatars import avatar
    from livehand.backend.field.field import FieldConfig
    from livehand.backend.field.sampler import SamplerConfig
    from livehand.backend.image.superres import SuperResConfig
    from livehand.backend.training import command
    from livehand.backend.training.config import TrainConfig

    field = FieldConfig(width=16, planes=((32, 2, 4),), relief=8)
    small = avatar.AvatarConfig(field, SuperResConfig(width=8, depth=2), SamplerConfig(4, 0.003))
    read = command.from_options

    def with_checkpoints(config, *arguments, **values):
        options = read(config, *arguments, **values)
        return replace(options, checkpoint_every=5) if config is TrainConfig else options

    yield patch.dict(avatar.PRESETS, default=small)
    yield patch.object(command, "from_options", with_checkpoints)


def _comparison():
    from livehand.backend.research.comparison import rows

    methods = [replace(method, resolution=64) if hasattr(method, "resolution") else method for method in rows.METHODS]
    yield patch.object(rows, "METHODS", methods)


def _capture():
    from livehand.backend.teacher import detailed_surface
    from livehand.livehand_blender.capture import bake, render

    yield patch.object(render, "detailed_surface", partial(detailed_surface.detailed_surface, levels=1))
    yield patch.object(render, "bake_skin", partial(bake.bake_skin, size_px=64))


def _person():
    from livehand.backend.person import making

    rounds = (making.RoundOptions(256, 36, with_flow=False),)
    yield patch.object(making, "MakingOptions", partial(making.MakingOptions, rounds))
    coarse = making.COARSE_ROUND._replace(resolution=128)
    yield patch.object(making, "COARSE_ROUND", coarse)
    yield patch.object(making, "LATER_ROUNDS", ((coarse,), (coarse, coarse)))


def _leases():
    from livehand.backend.batch import leases
    from livehand.backend.batch import leases as lease_owner

    if place := os.environ.get("KILLS_PLACE"):
        yield patch.object(lease_owner, "process_space", lambda: place)
        yield patch.object(leases, "STALE_S", STALE_S)
        yield patch.object(leases.FrameLeases.__init__, "__defaults__", (STALE_S / 10,))


if __name__ == "__main__":
    main()
