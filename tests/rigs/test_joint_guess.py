"""Bones are found by the names that riggers, formats and trackers give them, and by shape where names tell nothing."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.model import JOINT_NAMES
from livehand.backend.records.errors import LiveHandError
from livehand.backend.rigs.joint_guess import guess_joints
from livehand.backend.rigs.source_skeleton import JointMap

pytestmark = pytest.mark.slow

LIB = runpy.run_path(str(Path(__file__).parent / "skeletons.py"))
hand_bones, skeleton, points = LIB["hand_bones"], LIB["skeleton"], LIB["points"]
FINGERS = ("index", "middle", "pinky", "ring", "thumb")
TITLES = ("Index", "Middle", "Pinky", "Ring", "Thumb")
PLAIN = ("f_index", "f_middle", "f_pinky", "f_ring", "thumb")


def names_by(hand, joint, fingers=TITLES, tip=None, palm=None):
    """(16 names, 5 tips, 4 metacarpals) of formats with {f} the finger, {k} 1, 2, 3 and {z} 0, 1, 2."""
    joints = [joint.format(f=finger, k=k + 1, z=k) for finger in fingers for k in range(3)]
    tips = [tip.format(f=finger) if tip else None for finger in fingers]
    return [hand, *joints], tips, [palm.format(f=finger) if palm else None for finger in fingers[:4]]


def parts(hand, joint, long, thumb, fingers=TITLES, tip=None, palm=None):
    """As `names_by`, with {p} a part's name."""
    joints = [
        joint.format(f=finger, p=part) for finger in fingers for part in (thumb if finger.lower() == "thumb" else long)
    ]
    tips = [tip.format(f=finger) if tip else None for finger in fingers]
    return [hand, *joints], tips, [palm.format(f=finger) if palm else None for finger in fingers[:4]]


MAKEHUMAN = (2, 3, 5, 4, 1)
BIPED = (1, 2, 4, 3, 0)
CONVENTIONS = {
    "Rigify metarig": names_by("hand.R", "{f}.0{k}.R", PLAIN),
    "Rigify deform": names_by("DEF-hand.R", "DEF-{f}.0{k}.R", PLAIN),
    "Mixamo": names_by("mixamorig:RightHand", "mixamorig:RightHand{f}{k}", tip="mixamorig:RightHand{f}4"),
    "Mixamo numbered": names_by("mixamorig7:RightHand", "mixamorig7:RightHand{f}{k}"),
    "Unreal": names_by("hand_r", "{f}_0{k}_r", FINGERS, palm="{f}_metacarpal_r"),
    "MakeHuman": (
        ["wrist.R", *(f"finger{f}-{k}.R" for f in MAKEHUMAN for k in (1, 2, 3))],
        [None] * 5,
        [f"metacarpal{f - 1}.R" for f in MAKEHUMAN[:4]],
    ),
    "3ds Max Biped": (
        ["Bip01 R Hand", *(f"Bip01 R Finger{f}{k}" for f in BIPED for k in ("", "1", "2"))],
        [f"Bip01 R Finger{f}Nub" for f in BIPED],
        [None] * 4,
    ),
    "WebXR": parts(
        "wrist",
        "{f}-{p}",
        ("phalanx-proximal", "phalanx-intermediate", "phalanx-distal"),
        ("metacarpal", "phalanx-proximal", "phalanx-distal"),
        ("index-finger", "middle-finger", "pinky-finger", "ring-finger", "thumb"),
        tip="{f}-tip",
        palm="{f}-metacarpal",
    ),
    "OpenXR": parts(
        "XR_HAND_JOINT_WRIST_EXT_RIGHT",
        "XR_HAND_JOINT_{f}_{p}_EXT_RIGHT",
        ("PROXIMAL", "INTERMEDIATE", "DISTAL"),
        ("METACARPAL", "PROXIMAL", "DISTAL"),
        ("INDEX", "MIDDLE", "LITTLE", "RING", "THUMB"),
        tip="XR_HAND_JOINT_{f}_TIP_EXT_RIGHT",
        palm="XR_HAND_JOINT_{f}_METACARPAL_EXT_RIGHT",
    ),
    "Unity": parts(
        "RightHand",
        "Right{f}{p}",
        ("Proximal", "Intermediate", "Distal"),
        ("Proximal", "Intermediate", "Distal"),
        ("Index", "Middle", "Little", "Ring", "Thumb"),
    ),
    "VRM 1": parts(
        "rightHand",
        "right{f}{p}",
        ("Proximal", "Intermediate", "Distal"),
        ("Metacarpal", "Proximal", "Distal"),
        ("Index", "Middle", "Little", "Ring", "Thumb"),
    ),
    "VRoid": names_by("J_Bip_R_Hand", "J_Bip_R_{f}{k}", ("Index", "Middle", "Little", "Ring", "Thumb")),
    "Rokoko": parts(
        "RightHand",
        "Right{f}{p}",
        ("Proximal", "Medial", "Distal"),
        ("Proximal", "Medial", "Distal"),
        tip="Right{f}Tip",
    ),
    "Rokoko numbered": (
        [
            "RightHand",
            *(f"RightFinger{f}{part}" for f in MAKEHUMAN[:4] for part in ("Proximal", "Medial", "Distal")),
            *(f"RightFinger1{part}" for part in ("Metacarpal", "Proximal", "Distal")),
        ],
        [f"RightFinger{f}Tip" for f in MAKEHUMAN],
        [f"RightFinger{f}Metacarpal" for f in MAKEHUMAN[:4]],
    ),
    "SMPL-X": names_by("right_wrist", "right_{f}{k}", FINGERS),
    "Quest": names_by("b_r_wrist", "b_r_{f}{k}", FINGERS, tip="b_r_{f}_null"),
    "BVH": names_by("RightHand", "RightHand{f}{k}", tip="RightHand{f}3_end"),
    "Axis Neuron": names_by("RightHand", "RightHand{f}{k}", palm="RightInHand{f}"),
    "DAZ": names_by("rHand", "r{f}{k}", ("Index", "Mid", "Pinky", "Ring", "Thumb")),
    "DAZ 9": names_by("r_hand", "r_{f}{k}", ("index", "mid", "pinky", "ring", "thumb"), palm="r_{f}metacarpal"),
    "parts": parts("RightHand", "Right{f}{p}", ("Root", "Middle", "Tip"), ("Root", "Middle", "Tip")),
    "lower case": names_by("righthand", "righthand{f}{k}", FINGERS),
    "letters": names_by("R_hand", "R_{f}_{k}", FINGERS),
    "ours": names_by("wrist.R", "{f}{k}.R", FINGERS, tip="IK-{f}.R"),
}


def other_side(name):
    for here, there in (("Right", "Left"), ("right", "left"), ("RIGHT", "LEFT")):
        if here in name:
            return name.replace(here, there)
    for here, there in ((".R", ".L"), ("_r", "_l"), ("R_", "L_"), (" R ", " L "), ("_R_", "_L_")):
        if here in name:
            return name.replace(here, there)
    return "l" + name[1:] if name.startswith("r") and (name[1].isupper() or name[1] == "_") else name


def body(side_bones):
    """A spine, arms with twist bones and feet with toes, above two hands."""
    trunk = [("Hips", None, (0, 0, 1)), ("Spine", "Hips", (0, 0, 1.2)), ("Head", "Spine", (0, 0, 1.6))]
    trunk += [
        ("LeftToeBase", "Hips", (0.1, 0, 0)),
        ("RightToe_Index1", "Hips", (0.1, 0, 0)),
        ("earring_r", "Head", (0, 0, 2)),
    ]
    for side, bones in side_bones.items():
        trunk += [(f"{side}_arm", "Spine", (0, 0, 1.3)), (f"{side}_arm_twist_01", f"{side}_arm", (0, 0, 1.3))]
        trunk += bones
    return skeleton(trunk)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_the_hand_alone(convention):
    names, tips, palms = CONVENTIONS[convention]
    guess = guess_joints(skeleton(hand_bones(names, tips, metacarpals=palms)))
    assert guess.bones == tuple(names)
    assert guess.side == "right"
    assert guess.tips == (tuple(tips) if convention != "ours" else (None,) * 5)
    assert guess.joint_map() == JointMap("right", guess.bones, guess.tips)


@pytest.mark.parametrize("convention", [name for name in CONVENTIONS if name != "WebXR"])
@pytest.mark.parametrize("side", ["right", "left"])
def test_both_hands_of_a_body(convention, side):
    hands = {}
    for own in ("left", "right"):
        turned = [
            [name and (name if own == "right" else other_side(name)) for name in group]
            for group in CONVENTIONS[convention]
        ]
        hands[own] = hand_bones(turned[0], turned[1], own, f"{own}_arm", turned[2]), turned[0]
    guess = guess_joints(body({own: bones for own, (bones, _) in hands.items()}), side)
    assert guess.bones == tuple(hands[side][1])
    assert guess.side == side


@pytest.mark.slow
def test_left_names_are_not_right_ones():
    for names, _tips, palms in CONVENTIONS.values():
        left = [other_side(name) for name in names]
        if left[0] == names[0]:
            continue
        alone = skeleton(hand_bones(left, metacarpals=palms, side="left"))
        assert guess_joints(alone).side == "left"
        assert guess_joints(alone).bones == tuple(left)
        assert guess_joints(alone, "right").missing == JOINT_NAMES


@pytest.mark.parametrize("side", ["right", "left"])
def test_names_without_a_side_take_that_of_the_bones_above_or_of_the_palm(side):
    names, tips, palms = CONVENTIONS["WebXR"]
    bones = hand_bones(names, tips, side, f"{side}_arm", palms)
    for whole in (skeleton(bones), skeleton([(f"{side}_arm", None, (0.3, 0, 0)), *bones])):
        assert guess_joints(whole).side == side
        assert guess_joints(whole).missing == ()
        assert guess_joints(whole, "left" if side == "right" else "right").missing == JOINT_NAMES


def test_twists_controls_and_copies_are_left_aside():
    names, tips, palms = CONVENTIONS["Unreal"]
    bones = hand_bones(names, tips, metacarpals=palms)
    extra = [("lowerarm_twist_01_r", None, (0, 0, 0)), ("ik_hand_r", None, (0, 0, 0)), ("hand_r.001", None, (0, 0, 0))]
    extra += [(f"{name}_correct", name, (0, 0, 0)) for name in names] + [("index_01_r.001", names[0], (0, 0, 0))]
    extra += [("index_01_twist_r", names[1], (0, 0, 0)), ("weapon_r", names[0], (0, 0, 0))]
    assert guess_joints(skeleton([*bones, *extra])).bones == tuple(names)


def test_rigify_deform_bones_are_taken_before_controls():
    control, deform = CONVENTIONS["Rigify metarig"], CONVENTIONS["Rigify deform"]
    original = [name.replace("DEF-", "ORG-") for name in deform[0]]
    bones = [bone for names in (control[0], original, deform[0]) for bone in hand_bones(names)]
    bones = [(name, parent if not name.startswith("DEF-f") else None, head) for name, parent, head in bones]
    masters = [
        ("f_index.01_master.R", "hand.R", (0, 0, 0)),
        ("MCH-f_index.02.R", "hand.R", (0, 0, 0)),
        ("hand_ik.R", None, (0, 0, 0)),
    ]
    assert guess_joints(skeleton([*bones, *masters])).bones == tuple(deform[0])


def test_counting_from_zero_begins_in_the_palm():
    names, _, _ = CONVENTIONS["Quest"]
    palms = [None, None, "b_r_pinky0", None]
    bones = [
        *hand_bones(names, metacarpals=palms),
        ("b_r_thumb0", names[0], (0, 0, 0)),
        ("b_r_forearm_stub", names[0], (0, 0, 0)),
    ]
    assert guess_joints(skeleton(bones)).bones == tuple(names)


def test_four_numbered_bones_are_a_tip_more_or_a_metacarpal_more():
    _joints, _tips = points()
    for with_tip in (True, False):
        names = ["hand_r", *(f"{f}{k + (not with_tip and f != 'thumb')}_r" for f in FINGERS for k in (1, 2, 3))]
        ends = [f"{f}4_r" for f in FINGERS] if with_tip else [None] * 5
        palms = [None] * 4 if with_tip else [f"{f}1_r" for f in FINGERS[:4]]
        guess = guess_joints(skeleton(hand_bones(names, ends, metacarpals=palms)))
        assert guess.bones == tuple(names)
        assert guess.tips == tuple(ends)


@pytest.mark.parametrize("gone", ["pinky", "thumb", "ring"])
def test_a_finger_that_is_missing_is_named(gone):
    names, tips, _ = CONVENTIONS["Mixamo"]
    kept = [None if gone in name.lower() else name for name in names]
    guess = guess_joints(skeleton([bone for bone in hand_bones(kept, tips) if gone not in bone[0].lower()]))
    assert guess.missing == tuple(f"{gone}{k}" for k in (1, 2, 3))
    assert guess.bones == tuple(kept)
    assert guess.joint_map().missing == guess.missing


def test_a_joint_that_is_missing_leaves_its_own_gap():
    names, _, _ = CONVENTIONS["Unreal"]
    bones = [bone for bone in hand_bones(names) if bone[0] != "index_02_r"]
    assert guess_joints(skeleton(bones)).missing == ("index2",)


@pytest.mark.slow
def test_six_fingers_are_not_five():
    names, _, _ = CONVENTIONS["Mixamo"]
    bones = hand_bones(names) + [(f"mixamorig:RightHandExtra{k}", "mixamorig:RightHand", (0, 0, 0)) for k in (1, 2, 3)]
    assert guess_joints(skeleton(bones)).bones == tuple(names)
    nameless = hand_bones([f"x{k}" for k in range(16)])
    nameless += [("y1", "x0", (0, 0, 0)), ("y2", "y1", (0, 0, 0)), ("y3", "y2", (0, 0, 0))]
    assert guess_joints(skeleton(nameless)).missing == JOINT_NAMES


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("extras", ["none", "tips", "metacarpals and tips"])
def test_hands_with_meaningless_names_are_found_by_shape_in_any_position(side, extras):
    rng = np.random.default_rng(0)
    names = [f"bone_{k:02}" for k in rng.permutation(16)]
    tips = [None] * 5 if extras == "none" else [f"end{k}" for k in rng.permutation(5)]
    palms = [f"m{k}" for k in rng.permutation(4)] if "metacarpals" in extras else [None] * 4
    bones = [("a", None, (0.3, 0, 0)), *hand_bones(names, tips, side, "a", palms), ("b", names[0], (0, 0, 0))]
    for _ in range(5):
        whole = skeleton(
            bones, axis_angle_to_matrix(rng.normal(size=3) * 2), rng.uniform(0.01, 100), rng.normal(size=3)
        )
        guess = guess_joints(whole)
        assert guess.bones == tuple(names)
        assert guess.side == side
        assert [tip for tip in guess.tips if tip] == [tip for tip in tips if tip]


def test_two_nameless_hands_are_distinguished():
    both = [("root", None, (0, 0, 0))]
    named = {side: [f"{initial}{k}x" for k in range(16)] for side, initial in (("right", "p"), ("left", "q"))}
    for side, names in named.items():
        both += hand_bones(names, side=side, above="root")
    for side, names in named.items():
        assert guess_joints(skeleton(both), side).bones == tuple(names)


def test_no_hand_at_all():
    guess = guess_joints(skeleton([("root", None, (0, 0, 0)), ("LeftHand", "root", (1, 0, 0))]))
    assert len(guess.missing) >= 15
    with pytest.raises(LiveHandError, match="there is no such hand"):
        guess.joint_map()


# A hand with a finger too few is not found by shape: here names alone decide.
def test_of_two_hands_the_right_one_is_guessed():
    both = {}
    for side in ("left", "right"):
        names = [name if side == "right" else other_side(name) for name in CONVENTIONS["Mixamo"][0]]
        both[side] = hand_bones([None if "Ring" in name else name for name in names], side=side, above=f"{side}_arm")
    guess = guess_joints(body(both))
    assert (guess.side, guess.bones[0]) == ("right", "mixamorig:RightHand")


def test_fingers_without_a_side_have_the_wrists():
    names = ["LeftHand", *(name.replace("Right", "") for name in CONVENTIONS["Mixamo"][0][1:])]
    kept = [None if "Ring" in name else name for name in names]
    guess = guess_joints(skeleton(hand_bones(kept, side="left")))
    assert guess.side == "left"
    assert guess.bones == tuple(kept)


def test_numbered_fingers_begin_at_the_thumb():
    names = [None if name.startswith("finger2-3") else name for name in CONVENTIONS["MakeHuman"][0]]
    guess = guess_joints(skeleton(hand_bones(names)))
    assert guess.bones == tuple(names)
    assert guess.missing == ("index3",)


ANATOMY = {
    "bare hand": ("WRIST", "{f}_{p}", ("MCP", "PIP", "DIP"), ("CMC", "MCP", "IP"), "{f}_TIP"),
    "right hand": ("RightWrist", "Right{f}{p}", ("MCP", "PIP", "DIP"), ("CMC", "MCP", "IP"), None),
    "fingers": ("wrist", "{f}_finger_{p}", ("mcp", "pip", "dip"), ("cmc", "mcp", "ip"), None),
    "three alike": ("hand", "{f}{p}", ("Mcp", "Pip", "Dip"), ("Mcp", "Pip", "Dip"), None),
}


@pytest.mark.parametrize("convention", ANATOMY)
@pytest.mark.parametrize("fingers", [TITLES, ("INDEX", "MIDDLE", "LITTLE", "RING", "THUMB")])
def test_anatomical_names(convention, fingers):
    hand, joint, long, thumb, tip = ANATOMY[convention]
    names, tips, palms = parts(hand, joint, long, thumb, fingers, tip)
    guess = guess_joints(skeleton(hand_bones(names, tips, metacarpals=palms)), "right")
    assert guess.bones == tuple(names)
    assert guess.tips == tuple(tips)


def test_a_thumb_named_from_its_second_joint_lacks_the_first():
    names, tips, _ = parts("WRIST", "{f}_{p}", ("MCP", "PIP", "DIP"), ("CMC", "MCP", "IP"), tip="{f}_TIP")
    bones = [bone if bone[1] != "Thumb_CMC" else (bone[0], "WRIST", bone[2]) for bone in hand_bones(names, tips)]
    guess = guess_joints(skeleton([bone for bone in bones if bone[0] != "Thumb_CMC"]), "right")
    assert guess.missing == ("thumb1",)
    assert guess.bones[14:] == ("Thumb_MCP", "Thumb_IP")


def test_names_of_fingers_overrule_their_shape():
    """The little finger stands nearest to the thumb, and parts have words that nobody knows."""
    swap = {"Index": "Pinky", "Pinky": "Index", "Middle": "Ring", "Ring": "Middle", "Thumb": "Thumb"}
    shuffled = tuple(swap[title] for title in TITLES)
    names, *_ = parts("RightHand", "Right{f}{p}", ("Alpha", "Beta", "Gamma"), ("Alpha", "Beta", "Gamma"), shuffled)
    guess = guess_joints(skeleton(hand_bones(names)), "right")
    joints = {finger: slice(3 * k + 1, 3 * k + 4) for k, finger in enumerate(FINGERS)}
    for title in TITLES:
        wanted = tuple(f"Right{title}{part}" for part in ("Alpha", "Beta", "Gamma"))
        assert guess.bones[joints[title.lower()]] == wanted


def test_bones_numbered_against_their_hierarchy_keep_its_order():
    """The thumb's metacarpal is called after the palm, and the count begins behind it."""
    names, tips, palms = names_by("Hand_R", "{f}_{z}_R", tip="{f}_Tip_R", palm="{f}_Palm_R")
    names[13:] = "Thumb_Palm_R", "Thumb_0_R", "Thumb_1_R"
    guess = guess_joints(skeleton(hand_bones(names, tips, metacarpals=palms)))
    assert guess.bones == tuple(names)
    assert guess.tips == tuple(tips)


@pytest.mark.parametrize("share", [0.2, 0.35, 0.5])
def test_a_metacarpal_that_is_numbered_first_is_none_of_the_joints(share):
    """Wherever in the palm the metacarpals begin, and though only two fingers have them."""
    names = ["hand_r", *(f"{f}{k + (f in ('ring', 'pinky'))}_r" for f in FINGERS for k in (1, 2, 3))]
    bones = hand_bones(names, metacarpals=[None, None, "pinky1_r", "ring1_r"])
    joints, _ = points()
    first = {"pinky1_r": joints[7], "ring1_r": joints[10]}
    bones = [(n, p, (1 - share) * joints[0] + share * first[n] if n in first else head) for n, p, head in bones]
    assert guess_joints(skeleton(bones)).bones == tuple(names)


def test_a_rig_with_three_fingers_or_without_last_joints_has_a_map():
    names, *_ = CONVENTIONS["Mixamo"]
    for gone in (("Ring", "Pinky"), ("Pinky3", "Ring3"), ("Thumb1",)):
        kept = [None if any(word in name for word in gone) else name for name in names]
        guess = guess_joints(skeleton(hand_bones(kept)))
        assert guess.bones == tuple(kept)
        assert guess.joint_map().missing == guess.missing
        assert all(guess.joint_map().drivers)


def test_too_little_of_a_hand_has_no_map():
    names, *_ = CONVENTIONS["Mixamo"]
    kept = [name if "Index" in name or name.endswith("Hand") else None for name in names]
    with pytest.raises(LiveHandError, match="first joints of two fingers beside the thumb must have a bone"):
        guess_joints(skeleton(hand_bones(kept))).joint_map()


def test_a_bone_named_a_tip_that_does_not_end_its_finger_is_no_tip():
    names, tips, _ = CONVENTIONS["Quest"]
    bones = hand_bones(names, tips)
    moved = [(n, p, (0.0, 0.0, 0.0) if n == tips[1] else head) for n, p, head in bones]
    assert guess_joints(skeleton(moved)).tips == (tips[0], None, *tips[2:])


def test_a_control_with_a_shorter_name_is_no_joint():
    names, tips, _ = CONVENTIONS["MakeHuman"]
    bones = hand_bones(names, tips)
    beside = points()[0][14] + [0.0, 0.01, 0.02]
    for at in (1, len(bones)):
        with_control = [*bones[:at], ("finger1.R", "wrist.R", beside), *bones[at:]]
        assert guess_joints(skeleton(with_control)).bones == tuple(names)


def wristless(side="right"):
    """Bones of a hand whose five chains begin at the end of the forearm: Bone, and Bone.001 to Bone.020."""
    joints, tips = points(side)
    elbow = joints[0] - 2.2 * (joints[4] - joints[0])
    bones, numbered = [("Bone", None, elbow)], iter(range(1, 100))
    for finger in range(5):
        above = "Bone"
        for place in (joints[0], *joints[3 * finger + 1 : 3 * finger + 4]):
            name = f"Bone.{next(numbered):03d}"
            bones.append((name, above, place))
            above = name
    return bones, tips


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("is_named", [False, True])
def test_a_hand_without_a_wrists_bone_begins_at_its_metacarpals(side, is_named):
    bones, _ = wristless(side)
    wanted = ("Bone.005", *(f"Bone.{4 * finger + k:03d}" for finger in range(5) for k in (2, 3, 4)))
    spelled = {"Bone": "Bone"}
    if is_named:
        spelled |= {"Bone": f"{side}_forearm"}
        for finger, name in enumerate(FINGERS):
            spelled |= {f"Bone.{4 * finger + k:03d}": f"{side}_{name}_{k}" for k in (1, 2, 3, 4)}
    rig = skeleton([(spelled.get(name, name), spelled.get(above, above), place) for name, above, place in bones])
    guess = guess_joints(rig)
    assert (guess.side, guess.bones) == (side, tuple(spelled.get(name, name) for name in wanted))
    assert guess.forearm == spelled["Bone"]


def test_a_chosen_side_holds_for_a_nameless_hand_that_rests_as_the_other():
    rig = skeleton(wristless("right")[0])
    assert guess_joints(rig, "left").missing
    chosen = guess_joints(rig, "left", is_determined=True)
    assert (chosen.side, chosen.bones[0]) == ("left", "Bone.005")
