"""Animations: what is where in a frame, files that play, and what happens to input that cannot be shown."""

import base64
import dataclasses
import io
import itertools
import json
import re
import sys
import time

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

import coopmm_jax as cm
from coopmm_jax.animation import scene, stage, writers
from coopmm_jax.animation.film import Animation, animate, frame_count
from coopmm_jax.animation.skeleton import placed, skeleton
from coopmm_jax.animation.surface import THICKNESS, normals
from coopmm_jax.parameters import Surface
from coopmm_jax.plotting.lines import runs
from tests.samples import SHAPES

PULLED = tuple(round(255 * part) for part in to_rgb(scene.PULLS["edgecolor"]))


@pytest.fixture(scope="module")
def run(simulated_paper):
    """The paper's start, in which the contact is lost: it presses at 0 s and pulls at 0.08 s."""
    return simulated_paper


@pytest.fixture(scope="module")
def failed(run):
    trajectory = cm.simulate(run.scenario.with_overrides({"gains.beta": 126.7, "gains.lam_min": 0.63}))
    assert not trajectory.ok
    return trajectory


@pytest.fixture(scope="module")
def brief(run):
    """More frames than a palette is chosen from."""
    return shortened(run, 521)


@pytest.fixture(scope="module")
def animation(brief):
    return Animation(brief, width=480)


def shortened(run, samples):
    """The first samples of a run."""
    arrays = {
        name: value[:samples]
        for name, value in vars(run).items()
        if isinstance(value, np.ndarray) and len(value) == len(run.t)
    }
    return dataclasses.replace(run, **arrays)


def pixels(picture, colour, within=0):
    """Number of pixels of a picture that have a colour, as the colour itself or but for some of 255 in each channel."""
    return int((np.abs(picture - np.array(colour)) <= within).all(axis=-1).sum())


def words(views, k):
    """Words of the readouts at frame k."""
    readouts = [view for view in views if isinstance(view, stage.Readout)]
    for readout in readouts:
        readout.show(k)
    return [readout.cast.artists[0].get_text() for readout in readouts]


def test_joints_end_where_the_simulation_has_the_tips(run):
    s = skeleton(run, np.arange(len(run.t)))
    np.testing.assert_allclose(s.joints[:, :, 3], run.tip, rtol=0, atol=1e-14)
    lengths = np.linalg.norm(np.diff(s.joints, axis=2), axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to([1.0, 0.5, 0.5], lengths.shape), rtol=1e-14)


def test_contact_lies_on_the_arc_and_its_normal_points_out_of_it(run):
    s = skeleton(run, np.arange(len(run.t)))
    to_contact = run.tip[:, 0, :2] - (run.tip[:, 1, :2] - 0.7 * s.along)
    np.testing.assert_allclose(np.hypot(*to_contact.T), 0.7, rtol=1e-9)
    np.testing.assert_allclose(s.normal, to_contact / 0.7, rtol=0, atol=1e-9)
    inner, outer = np.split(np.array([0.7, 0.0]) + s.surface.outline(0.02), 2)
    np.testing.assert_allclose(np.linalg.norm(inner, axis=1), 0.72, rtol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(outer, axis=1), 0.72 + THICKNESS, rtol=1e-14)
    np.testing.assert_array_equal(s.shift, 0.0)
    np.testing.assert_array_equal(s.force, run.constraint_force[:, 0])


@pytest.mark.parametrize("name", SHAPES)
def test_any_surface_is_drawn_where_its_level_vanishes(name):
    shape = SHAPES[name]
    n = np.array([-0.3, 0.0, 0.2])
    points = np.stack([[float(shape.along(x)) for x in n], n], axis=-1)
    normal = normals(Surface(shape=shape), points)
    assert np.all(np.asarray(shape.level(*(points + 1e-6 * normal).T)) < 0.0)
    assert np.all(np.asarray(shape.level(*(points - 1e-6 * normal).T)) > 0.0)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, rtol=1e-14)


def test_robots_should_be_on_the_papers_circles(run):
    s = skeleton(run, np.arange(len(run.t)))
    circles = np.array([2.4, 1.0])[:, None] * np.stack([np.cos(run.t), np.sin(run.t)], axis=-1)[:, None]
    np.testing.assert_allclose(s.desired, circles, rtol=0, atol=1e-14)


def test_outlines_turn_with_the_platform():
    ahead = placed(np.array([[0.0, 1.0], [1.0, 0.0]]), np.array([2.0, 3.0]), np.array([-np.sin(0.3), np.cos(0.3)]))
    lateral = [2.0 + np.cos(0.3), 3.0 + np.sin(0.3)]  # (cos th, sin th) from the midpoint
    np.testing.assert_allclose(ahead, [[2.0 - np.sin(0.3), 3.0 + np.cos(0.3)], lateral], rtol=1e-15)


def arrow_at(view, k):
    view.show(k)
    polygon = view.cast.artists[-1]
    tail, tip = polygon.get_xy()[[0, 6]].mean(axis=0), polygon.get_xy()[3]
    return polygon, tip - tail, tail


def test_arrow_presses_on_the_object_or_pulls_it_back(run):
    group, times = runs([run], None), np.array([0.0, 0.08])
    above, side, *_ = stage.stage(group, times, 480)[1]
    s = skeleton(run, stage.instants(run.t, times))
    assert s.force[0] > 0 > s.force[1]
    for k, length in ((0, scene.ARROW * s.force[0] / 15.0), (1, -scene.LONGEST_ARROW)):
        polygon, arrow, tail = arrow_at(above, k)
        np.testing.assert_allclose(arrow, length * s.normal[k], rtol=1e-9)
        np.testing.assert_allclose(tail, s.joints[k, 0, 3, :2], rtol=1e-12)
        assert (polygon.get_hatch() is None) == (length > 0)
        _, arrow, _ = arrow_at(side, k)
        np.testing.assert_allclose(arrow, [length * s.normal[k] @ s.along[k], 0.0], rtol=1e-9, atol=1e-12)
        assert arrow[0] * length > 0  # robot I is on the left and presses to the right


def test_frames_follow_the_clock(run):
    assert frame_count(1.0, fps=25.0, speed=1.0, width=400) == 26
    assert Animation(run, fps=10, speed=0.5, width=400).times.tolist() == pytest.approx(np.arange(21) * 0.05)
    assert stage.instants(run.t, np.array([0.0, 0.04, 0.0405, 1.0, 3.0])).tolist() == [0, 40, 40, 1000, 1000]
    assert stage.instants(run.t.astype(np.float32), np.arange(26) * 0.04).tolist() == list(range(0, 1001, 40))


def test_a_frame_does_not_depend_on_those_drawn_before(brief, animation):
    first = animation.picture(2)
    assert (first.dtype, first.shape[1:]) == (np.uint8, (480, 3))
    assert not np.array_equal(animation.picture(10), first)
    np.testing.assert_array_equal(animation.picture(2), first)
    np.testing.assert_array_equal(Animation(brief, width=480).picture(2), first)


def test_pulling_has_a_colour_of_its_own(animation):
    still = pixels(animation.picture(0), PULLED, within=30)  # in the strip over time
    assert pixels(animation.picture(2), PULLED, within=30) > still + 50


def test_time_and_force_are_told(run):
    _, views = stage.stage(runs([run], None), np.array([0.0, 0.08]), 480)
    force = run.constraint_force[[0, 80], 0]
    assert words(views, 0) == ["t = 0.00 s", f"contact force {force[0]:.1f} N"]
    assert words(views, 1) == ["t = 0.08 s", f"contact force {force[1]:.1f} N: pulls"]


def test_runs_that_end_before_the_other_say_so(run, failed):
    times = np.array([0.0, 0.3, 1.0])
    group = runs([run, shortened(run, 201), failed], ["whole", "short", "failed"])
    _, views = stage.stage(group, times, 900)
    assert words(views, 1)[::2] == ["t = 0.30 s", "ended at 0.20 s", f"SPEED at {failed.status_time:g} s"]
    assert words(views, 0)[::2] == ["t = 0.00 s"] * 3


def test_run_that_fails_shows_it_in_its_last_frame(failed):
    animation = Animation(failed, width=400)
    assert len(animation) == 1
    assert pixels(animation.picture(0), PULLED, within=30) > 50


@pytest.mark.parametrize("width", [400, 480, 800])
@pytest.mark.parametrize("count", [1, 2])
def test_nothing_overlaps(width, count, run):
    """Views with their labels and words stay apart and inside the picture."""
    width = max(width, 240 * count)
    figure, views = stage.stage(runs([run] * count, ["one run", "another"][:count]), np.array([0.0, 1.0]), width)
    for view in views:
        view.show(0)
        for artist in view.cast.artists:
            artist.set_animated(False)  # animated artists have no part in a layout
    boxes = [axes.get_tightbbox() for axes in figure.axes]
    for one, other in itertools.combinations(boxes, 2):
        assert one.x1 <= other.x0 + 1 or other.x1 <= one.x0 + 1 or one.y1 <= other.y0 + 1 or other.y1 <= one.y0 + 1
    for box in boxes:
        assert min(box.x0, box.y0) >= -1
        assert (box.x1 <= width + 1, box.y1 <= figure.bbox.y1 + 1) == (True, True)


def test_gif_plays_as_long_as_the_run_in_its_own_colours(brief, animation, tmp_path):
    animate(brief, path=tmp_path / "run.gif", width=480)
    assert [path.name for path in tmp_path.iterdir()] == ["run.gif"]
    with Image.open(tmp_path / "run.gif") as gif:
        assert gif.n_frames == len(animation) == 14 > writers.SAMPLED
        assert gif.info["loop"] == 0
        durations, differences = [], []
        for k in range(gif.n_frames):
            gif.seek(k)
            durations.append(gif.info["duration"])
            shown = np.asarray(gif.convert("RGB"))
            differences.append(np.abs(shown - animation.picture(k).astype(int)).mean())
            if k == 2:
                assert pixels(shown, PULLED) >= pixels(animation.picture(k), PULLED) > 0
                assert pixels(shown, (255, 255, 255)) > 0.5 * shown[..., 0].size
    assert durations == [40] * 13 + [40 + 1000 * writers.PAUSE]
    assert max(differences) < 1.5
    assert (tmp_path / "run.gif").stat().st_size < 14 * 10_000


def test_gif_keeps_time_at_rates_its_clock_does_not_have(run, tmp_path):
    animate(shortened(run, 201), path=tmp_path / "run.gif", width=400, fps=30)
    with Image.open(tmp_path / "run.gif") as gif:
        total = 0
        for k in range(gif.n_frames):
            gif.seek(k)
            total += gif.info["duration"]
    assert total == pytest.approx(7 / 30 * 1000 + 1000 * writers.PAUSE, abs=5)


def test_page_holds_every_frame_and_needs_nothing_else(brief, animation, tmp_path):
    animate(brief, path=tmp_path / "run.html", width=480)
    page = (tmp_path / "run.html").read_text(encoding="utf-8")
    assert not re.search(r"https?:|src=|href=|\$[A-Z]", page)
    found = re.search(r"const \[background, ...frames\] = (\[.*?\]), about = (\{.*\});", page)
    layers, about = map(json.loads, found.groups())
    assert len(layers) == 1 + 14
    assert (about["fps"], about["cuts"]) == (25, [0, 249, 480])
    shown = Image.new("RGBA", (480, animation.picture(0).shape[0]))
    for layer in (layers[0], layers[1 + 2]):
        with Image.open(io.BytesIO(base64.b64decode(layer))) as picture:
            shown = Image.alpha_composite(shown, picture.convert("RGBA"))
    difference = np.asarray(shown.convert("RGB")) - animation.picture(2).astype(int)
    assert np.abs(difference).mean() < 1.5


def test_background_of_a_page_is_what_is_seen_most_often(animation):
    """Most pixels of a frame are then transparent, which keeps the page small."""
    entry = np.arange(1 << 15)
    still = writers._still(animation, entry)
    differs = [np.mean(writers._bin(animation.picture(k)) != still) for k in range(len(animation))]
    assert 0.0 < max(differs) < 0.05


@pytest.fixture
def ffmpeg(monkeypatch, tmp_path):
    """Puts a program in ffmpeg's place."""

    def install(code):
        programs = tmp_path / "programs"
        programs.mkdir()
        program = programs / "ffmpeg"
        program.write_text(f"#!{sys.executable}\nimport sys\n{code}\n")
        program.chmod(0o755)
        monkeypatch.setenv("PATH", str(programs))

    return install


def test_film_is_fed_to_ffmpeg_frame_by_frame(brief, animation, ffmpeg, tmp_path):
    ffmpeg("open(sys.argv[-1], 'wb').write(sys.stdin.buffer.read() + ' '.join(sys.argv[1:-1]).encode())")
    animate(brief, path=tmp_path / "run.mp4", width=480)
    film = (tmp_path / "run.mp4").read_bytes()
    height = animation.picture(0).shape[0]
    frame = height * 480 * 3
    assert height % 2 == 0
    assert film[2 * frame : 3 * frame] == animation.picture(2).tobytes()
    options = film[14 * frame :].decode()
    assert f"-f rawvideo -pix_fmt rgb24 -s 480x{height} -r 25 -i -" in options


def test_ffmpeg_that_fails_leaves_the_old_film(brief, ffmpeg, tmp_path):
    ffmpeg("open(sys.argv[-1], 'w').write('half a film'); sys.exit('no such codec')")
    (tmp_path / "run.mp4").write_text("old")
    with pytest.raises(cm.UserError, match=r"--out: must be a film that ffmpeg can write, was refused: no such codec"):
        animate(brief, path=tmp_path / "run.mp4", width=480)
    assert (tmp_path / "run.mp4").read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["programs", "run.mp4"]


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("run.png", {}, "--out: must be a file that ends in .gif, .html, .mp4, was "),
        ("run.mp4", {}, "--out: must be a .gif or .html file where ffmpeg is not installed, was an .mp4 file"),
        ("folder.gif", {}, "--out: must be a file, was the folder "),
        ("run.gif", {"width": 398}, "width: must be an even number of pixels from 400 to 1920, was 398"),
        ("run.gif", {"width": 401}, "width: must be an even number of pixels from 400 to 1920, was 401"),
        ("run.gif", {"fps": 0.0}, "fps: must be from 0.01 to 50 frames per second, was 0.0"),
        ("run.gif", {"speed": -1.0}, "speed: must be above 0 simulated seconds per second, was -1.0"),
        ("run.gif", {"labels": ["a", "b"]}, "labels: must be 1, one for each trajectory, was 2"),
    ],
)
def test_what_cannot_be_animated(name, changes, message, run, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    (tmp_path / "folder.gif").mkdir()
    with pytest.raises(cm.UserError, match=re.escape(message)):
        animate(run, path=tmp_path / name, **changes)
    assert [path.name for path in tmp_path.iterdir()] == ["folder.gif"]


def test_runs_without_samples_and_pictures_too_narrow_for_them(run):
    with pytest.raises(cm.UserError, match="trajectories: must be runs with at least one sample"):
        Animation(shortened(run, 0))
    with pytest.raises(cm.UserError, match="width: must be an even number of pixels from 720 to 1920, was 480"):
        Animation(run, run, run, width=480)


def test_twenty_seconds_take_less_than_a_minute(run, tmp_path):
    """Of a core: 25 frames in a twentieth of what 500 may take."""
    before = time.process_time()
    animate(run, path=tmp_path / "run.gif", fps=24.0)
    assert time.process_time() - before < 3.0
