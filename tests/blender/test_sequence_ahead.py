"""Sequences with prefetched frames: the same files and the same errors as without."""

import signal
import threading
import time

import bpy
import numpy as np
import pytest
from livehand.backend.batch import frame_paths
from livehand.backend.batch.frame_file import check_frame
from livehand.backend.batch.progress import ShotTally
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.progress import RenderStopped
from livehand.livehand_blender.render.engine import LiveHandRender
from livehand.livehand_blender.render.plan import SequencePlan
from livehand.livehand_blender.render.sequence import write_sequence
from livehand.livehand_blender.rig.hand import find_hands, mesh_of

SECONDS = 10  # no test waits that long unless it fails


@pytest.fixture
def moving_scene(hand_scene):
    """Four frames in which everything moves: fingers, armature, camera with a cut, and a render-only modifier."""
    armature = find_hands(hand_scene)[0]
    bone = armature.pose.bones["index1.R"]
    swell = mesh_of(armature).modifiers.new("Swell", "DISPLACE")
    swell.show_viewport, swell.mid_level = False, 0
    cut_to = bpy.data.objects.new("Cut", bpy.data.cameras.new("Cut"))
    cut_to.location = (-0.1, 0.01, 0.4)
    hand_scene.collection.objects.link(cut_to)
    hand_scene.timeline_markers.new("first", frame=1).camera = hand_scene.camera
    hand_scene.timeline_markers.new("cut", frame=3).camera = cut_to
    for frame in (1, 4):
        bone.rotation_quaternion = (1, 0.1 * frame, 0, 0)
        bone.keyframe_insert("rotation_quaternion", frame=frame)
        armature.location.x = 0.01 * frame
        armature.keyframe_insert("location", frame=frame)
        hand_scene.camera.data.lens = 50 + frame
        hand_scene.camera.data.keyframe_insert("lens", frame=frame)
        swell.strength = 0.002 * frame
        swell.keyframe_insert("strength", frame=frame)
    hand_scene.frame_start, hand_scene.frame_end = 1, 4
    return hand_scene


@pytest.fixture
def save_shot(tmp_path):
    """A function: save the open scene; returns its path."""

    def save():
        path = tmp_path / "wave.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
        return path

    return save


def counts(tally):
    return tally.number_of("written"), tally.number_of("skipped")


def names(folder):
    """All but the frames' records."""
    return sorted(path.name for path in folder.iterdir() if path.suffix != ".json")


def write(shot_path, folder, **choices):
    tally = ShotTally(folder)
    write_sequence(SequencePlan(shot_path, folder, **choices), tally.add)
    return tally


def shots(session):
    return [shot for renderer in session.made for shot in renderer.shots]


def write_each_frame_alone(shot_path, folder):
    for frame in range(1, 5):
        write(shot_path, folder, frames=(frame,))


def assert_same_files(folder, other, read_exr):
    for path in sorted(other.glob("*.exr")):
        channels, expected = read_exr(folder / path.name), read_exr(other / path.name)
        assert channels.keys() == expected.keys()
        assert all(np.array_equal(channels[name], expected[name]) for name in expected), path.name


def test_every_frame_is_prefetched_and_is_the_same_as_without(
    moving_scene, save_shot, tmp_path, fake_session, read_exr
):
    shot_path = save_shot()
    write_each_frame_alone(shot_path, tmp_path / "alone")
    alone = shots(fake_session)
    write(shot_path, tmp_path / "ahead")
    ahead = shots(fake_session)[len(alone) :]
    assert len(ahead) == len(alone) == 4  # one render each: no guess was wrong
    assert all(np.array_equal(one.vertices, other.vertices) for one, other in zip(alone, ahead, strict=True))
    assert len({shot.vertices.tobytes() for shot in alone}) == 4
    assert len({shot.camera.K.tobytes() for shot in alone}) >= 3
    assert_same_files(tmp_path / "ahead", tmp_path / "alone", read_exr)


def test_the_next_frame_is_rendered_while_one_is_written(
    moving_scene, save_shot, tmp_path, fake_session, fake_renderer, monkeypatch
):
    begun = [threading.Event() for _ in range(4)]
    render = fake_renderer.render

    def signal_and_render(self, shot, should_stop):
        begun[len(self.shots)].set()
        return render(self, shot, should_stop)

    written = []

    def wait_for_the_next_and_check(path, size_px):
        written.append(path)
        assert begun[min(len(written), 3)].wait(SECONDS)  # without prefetching it would begin after this
        check_frame(path, size_px)

    monkeypatch.setattr(fake_renderer, "render", signal_and_render)
    monkeypatch.setattr(frame_paths, "check_frame", wait_for_the_next_and_check)
    assert write(save_shot(), tmp_path / "out").number_of("written") == 4


def test_wrong_guesses_are_never_written(moving_scene, save_shot, tmp_path, fake_session, read_exr, monkeypatch):
    prefetch = LiveHandRender._prefetch

    def prefetch_another(self, depsgraph, queue, frame):
        prefetch(self, depsgraph, queue, frame + 7 if frame % 2 else frame + 1)

    shot_path = save_shot()
    write_each_frame_alone(shot_path, tmp_path / "alone")
    before = len(shots(fake_session))
    monkeypatch.setattr(LiveHandRender, "_prefetch", prefetch_another)
    write(shot_path, tmp_path / "misled")
    assert len(shots(fake_session)) - before <= 4 + 2  # after two wrong guesses there are no more
    assert_same_files(tmp_path / "misled", tmp_path / "alone", read_exr)


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (LiveHandError, "^frame 2: no more$"),
        (ZeroDivisionError, "^frame 2: LiveHand stopped on an unexpected ZeroDivisionError: no more$"),
        (MemoryError, "^frame 2: more memory must be free than there is; make the image smaller"),
    ],
)
def test_an_error_in_the_thread_names_its_frame(
    moving_scene, save_shot, tmp_path, fake_session, fake_renderer, monkeypatch, error, message
):
    render = fake_renderer.render

    def fail_on_the_second(self, shot, should_stop):
        frame = render(self, shot, should_stop)
        if len(self.shots) == 2:
            raise error("no more")
        return frame

    monkeypatch.setattr(fake_renderer, "render", fail_on_the_second)
    with pytest.raises(LiveHandError, match=message):
        write(save_shot(), tmp_path / "out")
    assert names(tmp_path / "out") == ["wave_0001.exr"]


def wait_until(condition):
    for _ in range(1000 * SECONDS):
        if condition():
            return True
        time.sleep(0.001)
    return False


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_reaches_the_renderer(
    hand_scene, save_shot, tmp_path, fake_session, fake_renderer, monkeypatch, caplog, number
):
    was_stopped = []

    def press(self, shot, should_stop):
        signal.pthread_kill(threading.main_thread().ident, number)
        was_stopped.append(wait_until(should_stop))
        raise RenderStopped

    monkeypatch.setattr(fake_renderer, "render", press)
    with pytest.raises(KeyboardInterrupt):
        write(save_shot(), tmp_path / "out")
    assert was_stopped == [True]
    assert not (tmp_path / "out").exists()
    assert caplog.records == []
    assert signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL)


def test_a_second_ctrl_c_stops_the_render_in_the_thread(
    hand_scene, save_shot, tmp_path, fake_session, fake_renderer, monkeypatch
):
    was_stopped = []

    def press():
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    def press_twice(self, shot, should_stop):
        press()
        wait_until(lambda: signal.getsignal(signal.SIGINT) is signal.default_int_handler)
        press()
        was_stopped.append(wait_until(should_stop))
        raise RenderStopped

    monkeypatch.setattr(fake_renderer, "render", press_twice)
    with pytest.raises(KeyboardInterrupt):
        write(save_shot(), tmp_path / "out")
    assert was_stopped == [True]
    assert not (tmp_path / "out").exists()


def test_a_scene_that_fails_later_fails_at_that_frame(moving_scene, save_shot, tmp_path, fake_session):
    subdivision = mesh_of(find_hands(moving_scene)[0]).modifiers.new("Subdivision", "SUBSURF")
    for frame, is_shown in ((2, False), (3, True)):
        subdivision.show_render = is_shown
        subdivision.keyframe_insert("show_render", frame=frame)
    with pytest.raises(LiveHandError, match=r"^frame 3: the mesh of 'LiveHand' must keep its hand model's"):
        write(save_shot(), tmp_path / "out")
    assert names(tmp_path / "out") == ["wave_0001.exr", "wave_0002.exr"]


def test_finished_frames_are_not_prefetched(moving_scene, save_shot, tmp_path, fake_session):
    shot_path = save_shot()
    write(shot_path, tmp_path / "out", frames=(2, 4))
    report = write(shot_path, tmp_path / "out")
    assert counts(report) == (2, 2)
    assert len(shots(fake_session)) == 4


def test_view_layers_share_a_render_and_may_lack_the_hand(moving_scene, save_shot, tmp_path, fake_session, read_exr):
    moving_scene.view_layers.new("Again")
    without = moving_scene.view_layers.new("Without")
    collection = bpy.data.collections.new("Hand")
    moving_scene.collection.children.link(collection)
    for obj in (find_hands(moving_scene)[0], mesh_of(find_hands(moving_scene)[0])):
        moving_scene.collection.objects.unlink(obj)
        collection.objects.link(obj)
    without.layer_collection.children["Hand"].exclude = True
    for thing in moving_scene.objects:
        if thing.type == "CAMERA":
            thing.location.x = load_default_hand().v_template[:, 0].mean()  # over the middle of the fake disc
    write(save_shot(), tmp_path / "out")
    assert len(shots(fake_session)) == 4
    for path in (tmp_path / "out").glob("*.exr"):
        alpha = {layer: read_exr(path)[f"{layer}.Combined.A"] for layer in ("ViewLayer", "Again", "Without")}
        assert alpha["ViewLayer"].max() > 0.9
        assert np.array_equal(alpha["ViewLayer"], alpha["Again"])
        assert alpha["Without"].max() == 0


def test_after_a_run_renders_need_no_queue(moving_scene, save_shot, tmp_path, fake_session):
    write(save_shot(), tmp_path / "out")
    assert fake_session.queue is None
    assert [thread.name for thread in threading.enumerate() if thread.name.startswith("livehand-queue")] == []
    bpy.ops.render.render()
    assert len(shots(fake_session)) == 5


@pytest.mark.parametrize("name", ["{blend_name}", "a{b", "shot ##", "100%"])
def test_folder_names_are_literal(hand_scene, save_shot, tmp_path, fake_session, name):
    write(save_shot(), tmp_path / name, frames=(1,), formats=("exr", "png"))
    assert names(tmp_path / name) == ["wave_0001.exr", "wave_0001.png"]
