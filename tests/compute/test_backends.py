"""Backends inherit from the reference: they override its names alone, with its signatures, and numba what it must."""

import inspect
from collections import Counter

import pytest
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.compute.cuda import CudaBackend
from livehand.backend.compute.kernels.brdf import MirrorArrays
from livehand.backend.compute.kernels.edges import EdgeMask
from livehand.backend.compute.kernels.field import RayOutputs
from livehand.backend.compute.kernels.image import EnlargedArrays
from livehand.backend.compute.kernels.light import FeatureArrays, LampArrays, PointArrays
from livehand.backend.compute.kernels.nearby import NearArrays
from livehand.backend.compute.kernels.shadow import ShadowPoints
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.volume import Composite
from livehand.backend.image.shading import EnlargedRays
from livehand.backend.light.lamp_samples import LampSamples
from livehand.backend.light.lighting import LightFeatures, SurfacePoints
from livehand.backend.light.near_field_light import NearFieldFeatures
from livehand.backend.light.prefiltered_environment import PrefilteredEnvironment
from livehand.backend.light.shadow_maps import PointShadows
from livehand.backend.light.visibility import ShadowMapPoints
from livehand.backend.surface.edge_antialiasing import SurfaceBones

# What numba leaves to the reference: sequences of stages, of which it overrides the costly parts; and whole frames.
LEFT_TO_THE_REFERENCE = {
    "visibility",
    "point_shadows",
    "shading_inputs",
    "lit_frames",
    "baked_frames",
    "renders_whole_frames",
}
BY_NUMBA = set("""
    frames_at_once threads_of_frame
    skin_motion posed_mesh hand_extent local_rotations
    first_hit trace shade ray_renderer decoder decoder_inputs superres
    lit_share look_up ambient_occlusion light_features mesh_points indirect_diffuse near_field_light
    smooth_enlarged_rays shares_of_rays normals_at_steps coefficients_at_steps view_directions edge_avoiding_mean
    shade_image
    detail_mesh visible_surface ray_hits detailed_image blended
""".split())  # fmt: skip


def names_of(backend):
    return {name for name in vars(backend) if not name.startswith("_")}


def overridden(backend):
    """How often each name is defined between a backend and the reference."""
    above = backend.__mro__[: backend.__mro__.index(ReferenceBackend)]
    return Counter(name for one in above for name in names_of(one))


def parameters(backend, name):
    """Names, kinds and defaults, without `self`."""
    member = getattr(backend, name)
    if not callable(member):
        return type(member)
    return [(one.name, one.kind, one.default) for one in inspect.signature(member).parameters.values()]


def faults(backend):
    known, found, reference = names_of(ReferenceBackend), overridden(type(backend)), ReferenceBackend()
    unknown = [f"{name} is no stage of the reference" for name in sorted(found.keys() - known)]
    twice = [f"{name} is overridden {times} times" for name, times in sorted(found.items()) if times > 1]
    other = [
        f"{name} has other parameters than the reference's"
        for name in sorted(found.keys() & known)
        if parameters(backend, name) != parameters(reference, name)
    ]
    return unknown + twice + other


@pytest.mark.parametrize("backend", [NumbaBackend(), CudaBackend(ReferenceBackend())])
def test_a_backend_overrides_names_of_the_reference_alone_with_its_signatures(backend):
    assert faults(backend) == []


def test_numba_leaves_no_costly_stage_to_torch():
    """A stage that it lacks would run by torch, slow but right: nothing else would tell."""
    assert overridden(NumbaBackend).keys() == BY_NUMBA
    assert names_of(ReferenceBackend) == BY_NUMBA | LEFT_TO_THE_REFERENCE


def test_beside_a_gpu_shadow_maps_alone_are_made_elsewhere():
    assert overridden(CudaBackend).keys() == {"look_up"}


class Invented(ReferenceBackend):
    def relighted(self):
        """A name that nobody calls."""


class Renamed(ReferenceBackend):
    @staticmethod
    def ambient_occlusion(sky, shadows, normals):
        """A parameter with another name."""


class WithDefault(ReferenceBackend):
    @staticmethod
    def ray_hits(mesh, camera, pixel=None):
        """What the reference demands."""


class Again(NumbaBackend):
    frames_at_once = 3


@pytest.mark.parametrize(
    ("backend", "fault"),
    [
        (Invented, "relighted is no stage of the reference"),
        (Renamed, "ambient_occlusion has other parameters than the reference's"),
        (WithDefault, "ray_hits has other parameters than the reference's"),
        (Again, "frames_at_once is overridden 2 times"),
    ],
)
def test_planted_faults_are_found(backend, fault):
    assert faults(backend()) == [fault]


@pytest.mark.parametrize(
    ("arrays", "fields"),
    [
        (PointArrays, ["view_direction" if name == "view" else name for name in SurfacePoints._fields[:4]]),
        (LampArrays, [*LampSamples._fields[:-1], *PointShadows._fields]),
        (FeatureArrays, [name for name in LightFeatures._fields if name in FeatureArrays._fields]),
        (NearArrays, NearFieldFeatures._fields),
        (EnlargedArrays, EnlargedRays._fields),
        (ShadowPoints, ShadowMapPoints._fields),
        (MirrorArrays, [*PrefilteredEnvironment._fields, "side", "least_roughness"]),
        (EdgeMask, ["between", "part", "bone_of_face", *SurfaceBones._fields[1:]]),
        (RayOutputs, ["features", *Composite._fields[1:], "t", "dt"]),
    ],
)
def test_records_of_kernels_have_the_fields_of_the_tuples_that_fill_them(arrays, fields):
    """In their order: they are filled one after the other."""
    assert list(arrays._fields) == list(fields)
