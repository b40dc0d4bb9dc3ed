"""save_clip: files of a clip, their rerun, processes that die, and a cluster."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from tests.clips.conftest import COLOR, COUNT, FIRST, LAST, NOISE, RADIUS
from tests.motion.clip.sightings import sighted

import blurmatte as bm
from blurmatte.figures import draw_clip
from blurmatte.motion.clip.solving import as_solved
from blurmatte.motion.clip.workers import Failure
from blurmatte.sweep.model.priors import MotionPrior, OpacityPrior

NAMES = [f"layer.{k:06d}.exr" for k in range(FIRST, LAST + 1)]


def run_of(shot, **settings):
    frames = bm.read_frames(shot / "shot.####.exr")
    inputs = (*sorted(shot.glob("shot.*.exr")), shot / "plate.exr")
    return bm.clips.ClipRun(inputs, frames, bm.read(shot / "plate.exr"), **settings)


def saved(shot, folder, workers=None, **settings):
    """The report of a whole run."""
    *_, report = bm.save_clip(run_of(shot, **settings), folder, workers or bm.motion.Workers(1))
    return report


def contents(folder):
    """Bytes of all files by name."""
    return {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}


@pytest.fixture(scope="module")
def once(shot, tmp_path_factory):
    folder = tmp_path_factory.mktemp("once")
    return folder, saved(shot, folder)


def test_layers_and_table_are_those_of_the_frames_with_the_object(once, truth):
    folder, report = once
    assert [record.layer for record in report.records] == NAMES
    assert [record.frame for record in report.records] == list(range(FIRST, LAST + 1))
    assert report.problems == ()
    for record in report.records:
        layer = bm.read_layer(folder / record.layer)
        assert layer.size == truth[record.frame].size
        assert np.abs(layer.alpha - truth[record.frame].alpha).max() < 0.1
        assert record.box == layer.box
    header, *rows = (folder / "frames.csv").read_text().splitlines()
    assert header.startswith("frame,time,object,shot,x,y,radius")
    assert len(rows) == len(NAMES)
    assert (folder / "report.json").exists()


def test_every_frame_has_a_file_and_those_without_the_object_are_transparent(once, shot):
    """Exact: no number is missing, the size is that of the clip, and the count is reported."""
    folder, report = once
    numbers = run_of(shot).frames.frame_numbers
    assert sorted(p.name for p in folder.glob("layer.*")) == [f"layer.{k:06d}.exr" for k in numbers]
    others = [k for k in numbers if f"layer.{k:06d}.exr" not in NAMES]
    assert report.empty == len(others) == COUNT - len(NAMES)
    for k in others:
        layer = bm.read_layer(folder / f"layer.{k:06d}.exr")
        assert layer.empty
        assert layer.size == run_of(shot).frames.size
    assert json.loads((folder / "report.json").read_text())["empty_layers"] == report.empty


def test_layer_over_plate_is_the_frame(once, pictures):
    """Composites agree with the frames to 50 dB, noise of the frames apart."""
    folder, _ = once
    frames, plate = pictures
    for k, name in zip(range(FIRST, LAST + 1), NAMES, strict=True):
        d = bm.read_layer(folder / name).over(plate).rgb - frames[k].rgb
        assert np.sqrt(np.mean(d**2)) < 0.0115  # of which the noise is 0.01


def test_rerun_does_nothing_and_changes_no_byte(shot, once, monkeypatch):
    """Exact: nor is the color found again."""
    folder, _ = once
    monkeypatch.setattr("blurmatte.motion.clip.steps.color_in_scene", None)
    before = contents(folder)
    assert saved(shot, folder).new == 0
    assert contents(folder) == before


def test_sheet_shows_the_numbers_of_the_table(shot, once, monkeypatch):
    """Exact: those of the solutions, also if none is made in this run; the border is a doubt."""
    drawn = []

    def noted(plate, rows, *words, **named):
        drawn.extend(rows)
        return draw_clip(plate, rows, *words, **named)

    monkeypatch.setattr("blurmatte.clips.saving.draw_clip", noted)
    records = {record.frame: record for record in saved(shot, once[0]).records}
    seen = {row.frame: row.sighting for row in drawn if row.sighting}
    assert sorted(seen) == sorted(records) == list(range(FIRST, LAST + 1))
    for k, record in records.items():
        motion = seen[k].motion
        assert (*motion.center, motion.length) == (record.x, record.y, record.length)
        assert (motion.radius, motion.radius_std) == (record.radius, record.radius_std)
        assert " ".join(seen[k].doubts) == record.doubts
        assert record.doubts.startswith("It reaches the border") == (k == LAST)


def test_solution_has_no_doubt_of_a_detection_unless_it_disagrees(pictures):
    """Exact: a doubt of the detection stays where the other frames say nothing of the solution."""
    frames, plate = pictures
    solution = bm.solve(frames[FIRST], plate, bm.ColorModel(COLOR[:, None] / np.linalg.norm(COLOR)))
    motion = bm.measure_motion(solution)
    detection = sighted((500.0, 3.0), doubts=("Its position is off.",))
    row = bm.motion.FrameMotion(FIRST, None, detection)
    agrees = as_solved(replace(row, prior=MotionPrior(RADIUS, 0.1)), solution)
    assert_array_equal(agrees.sighting.motion.center, motion.center)
    assert agrees.sighting.doubts == motion.doubts == ()
    assert as_solved(row, solution).sighting.doubts == ("Its position is off.",)
    alone = replace(solution, stats=replace(solution.stats, grade_reasons=("clip",)))
    assert as_solved(row, alone).sighting.doubts[0].startswith("Its path or radius contradicts")
    nothing = replace(solution, alpha=np.zeros_like(solution.alpha), sweep=None)
    assert as_solved(row, nothing).sighting is None
    assert "alpha sums to 0.0" in as_solved(row, nothing).reason


def test_transfer_curves_belong_to_the_key(tmp_path, pictures):
    """Exact: frames that were read with another curve are not taken for done."""
    bm.write_frames(tmp_path / "f.####.png", pictures[0][:2])
    curves = bm.SRGB, bm.radiometry.named_transfer("rec709"), bm.SRGB
    clips = (bm.read_frames(tmp_path / "f.####.png", curve) for curve in curves)
    srgb, rec709, again = (bm.clips.ClipRun((), clip).key for clip in clips)
    assert rec709 != srgb == again


def test_settings_of_a_solver_belong_to_the_key(shot):
    """Exact: frames that were solved with other settings are not taken for done."""
    solvers = (
        None,
        bm.Smooth(),
        bm.matting.Averaged(),
        bm.matting.Averaged(seconds=3),
        bm.matting.Averaged(opacity=OpacityPrior.ANY),
    )
    keys = {run_of(shot, solver=solver).key for solver in solvers}
    assert len(keys) == len(solvers)


def test_interrupted_run_ends_with_the_same_bytes(shot, once, tmp_path):
    events = bm.save_clip(run_of(shot), tmp_path, bm.motion.Workers(1))
    for event in events:
        if isinstance(event, bm.clips.FrameRecord) and event.frame == FIRST + 2:
            break
    events.close()
    assert len(list(tmp_path.glob("layer.*.exr"))) == 3
    (tmp_path / NAMES[0]).unlink()  # a file that was lost is made again
    assert saved(shot, tmp_path).new == len(NAMES) - 2
    assert {name: contents(tmp_path)[name] for name in NAMES} == {
        name: contents(once[0])[name] for name in NAMES
    }
    assert (tmp_path / "frames.csv").read_bytes() == (once[0] / "frames.csv").read_bytes()


def test_movie_is_as_long_as_the_clip_and_table_may_be_parquet(shot, once, tmp_path):
    pq = pytest.importorskip("pyarrow.parquet")
    saved(shot, tmp_path, extension=".mov", table=".parquet")
    table = pq.read_table(tmp_path / "frames.parquet")
    assert table.column_names == (once[0] / "frames.csv").read_text().split("\n")[0].split(",")
    assert table["frame"].to_pylist() == list(range(FIRST, LAST + 1))
    layers = bm.read_layers(tmp_path / "layers.mov")
    assert len(layers) == COUNT
    assert [k for k, layer in enumerate(layers) if layer.alpha.max() > 0.1] == [
        *range(FIRST, LAST + 1)
    ]


def test_clip_in_which_nothing_moves_is_refused(shot, tmp_path):
    run = run_of(shot)
    run = bm.clips.ClipRun(run.inputs, run.frames[:3], run.plate)
    with pytest.raises(bm.errors.MotionError, match=r"frames 0 to 2: nothing moved"):
        list(bm.save_clip(run, tmp_path, bm.motion.Workers(1)))


def test_complete_layers_are_solutions(shot, tmp_path):
    """Exact: the file holds the sweep of the frame, and the light of the plain layer."""
    three = run_of(shot)
    three = bm.clips.ClipRun(three.inputs, three.frames[3:6], three.plate, complete=True)
    *_, report = bm.save_clip(three, tmp_path, bm.motion.Workers(1))
    for record in report.records:
        solution = bm.read_solution(tmp_path / record.layer)
        assert solution.sweep is not None
        assert solution.layer.alpha.sum() == pytest.approx(record.sum_alpha, rel=0.05)
    assert len(report.records) == 3
    assert report.empty == 0


def test_layers_of_an_earlier_run_are_not_mixed_with_those_of_a_new_one(shot, tmp_path):
    """Exact: a run replaces the layers of its frames; other frames and other files are kept."""
    saved(shot, tmp_path)
    names = sorted(path.name for path in tmp_path.glob("layer.*"))
    assert len(names) == COUNT
    others = "layer.000001.png", "layer.000099.exr"
    for name in others:
        (tmp_path / name).write_text("of another program")
    run = run_of(shot)
    run = bm.clips.ClipRun(run.inputs, run.frames[1:5], run.plate, complete=True)
    for _ in range(2):  # the second run resumes
        list(bm.save_clip(run, tmp_path, bm.motion.Workers(1)))
        kept = {path.name for path in tmp_path.glob("layer.*")}
        assert kept == {*others, *names} - {"layer.000001.exr", "layer.000002.exr"}
    saved(shot, tmp_path, complete=True)  # knows of the transparent layers two runs ago
    assert {path.name for path in tmp_path.glob("layer.*")} == {*others, *NAMES}


def test_other_layers_are_refused(shot):
    with pytest.raises(ValueError, match="gif"):
        run_of(shot, extension=".gif")
    with pytest.raises(ValueError, match="exr"):
        run_of(shot, extension=".png", complete=True)


def dies_once(flag, k):
    """Kills its process the first time that it is asked for 2."""
    if k == 2 and not Path(flag).exists():
        Path(flag).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * k


def fails(k):
    if k == 1:
        raise ValueError("one is bad")
    return k


def test_tasks_of_a_killed_process_are_done_again(tmp_path):
    tasks = [(str(tmp_path / "flag"), k) for k in range(5)]
    with bm.motion.Workers(2) as workers:
        assert list(workers.in_order(dies_once, tasks)) == [0, 10, 20, 30, 40]


@pytest.mark.parametrize("count", [1, 2])
def test_failure_is_named_and_the_rest_goes_on(count):
    with bm.motion.Workers(count) as workers:
        zero, failure, two = workers.outcomes(fails, [(0,), (1,), (2,)])
    assert (zero, two) == (0, 2)
    assert isinstance(failure, Failure)
    assert str(failure.error) == "one is bad"


KILLED_RUN = """
import os, signal, sys
from pathlib import Path
import blurmatte as bm
from blurmatte.clips.manifest import Manifest

shot, folder, stop = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
append, count = Manifest.append, [0]

def dying(self, one):
    count[0] += 1
    if count[0] == stop:
        self.file.write(b'{"shot')  # half a line
        os.kill(os.getpid(), signal.SIGKILL)
    append(self, one)

Manifest.append = dying
inputs = (*sorted(shot.glob("shot.*.exr")), shot / "plate.exr")
run = bm.clips.ClipRun(inputs, bm.read_frames(shot / "shot.####.exr"), bm.read(shot / "plate.exr"))
list(bm.save_clip(run, folder, bm.motion.Workers(1)))
"""


@pytest.mark.battery
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs POSIX signals")
@pytest.mark.parametrize(
    "stop", [4, COUNT + 2]
)  # while frames are measured, and while they are solved
def test_killed_run_ends_with_the_same_bytes(shot, once, tmp_path, stop):
    words = [sys.executable, "-c", KILLED_RUN, str(shot), str(tmp_path), str(stop)]
    killed = subprocess.run(words, capture_output=True, text=True, check=False)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert not (tmp_path / "frames.csv").exists()
    report = saved(shot, tmp_path)
    assert report.new == len(NAMES) - max(stop - 1 - COUNT, 0)
    assert contents(tmp_path) == contents(once[0])


def test_missing_pyav_is_stated_before_frames_are_solved(shot, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(bm.errors.FileError, match=r"blurmatte\[video\]"):
        run_of(shot, extension=".mov")


def test_missing_pyarrow_is_said_at_once(shot, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(bm.errors.FileError, match=r"blurmatte\[tables\]"):
        run_of(shot, table=".parquet")
    with pytest.raises(ValueError, match="xlsx"):
        run_of(shot, table=".xlsx")


@pytest.mark.battery
def test_graphics_in_front_of_the_scene_are_no_motion(pictures, truth):
    """A clock at the bottom changes in every frame; the ball is solved, and nothing else."""
    frames, plate = pictures
    hidden = np.zeros(plate.valid.shape, bool)
    hidden[36:48, 20:60] = True
    rng, shown = np.random.default_rng(4), []
    for frame in frames:
        light = frame.rgb.copy()
        light[38:46, 22:58] = rng.uniform(0, 1, (8, 36, 3))
        shown.append(bm.LinearImage(light, bm.NoiseModel(read_std=NOISE)))
    plate = plate.with_noise(bm.NoiseModel(read_std=1e-4))
    model = bm.ColorModel(COLOR[:, None] / np.linalg.norm(COLOR))
    solved = dict(bm.solve_clip(shown, plate, model, occluder=hidden))
    assert sorted(solved) == list(range(FIRST, LAST + 1))
    for k, solution in solved.items():
        error = np.where(solution.known, solution.alpha, 0) - truth[k].alpha
        assert np.sqrt(np.mean(error[truth[k].alpha > 0] ** 2)) < 0.02


def test_occluder_of_another_size_is_refused(pictures):
    frames, plate = pictures
    with pytest.raises(ValueError, match="occluder"):
        next(bm.solve_clip(frames, plate, occluder=np.zeros((3, 4), bool)))


def test_layers_agree_in_other_readers(once, pictures):
    """OpenEXR and oiio's own `over` composite a layer to the frame, noise of the frame apart."""
    OpenEXR = pytest.importorskip("OpenEXR")
    oiio = pytest.importorskip("OpenImageIO")
    folder, _ = once
    frames, plate = pictures
    k, name = FIRST + 2, str(folder / NAMES[2])
    with OpenEXR.File(name) as file:
        rgba = file.channels()["RGBA"].pixels
    under = np.dstack([plate.rgb, np.ones(plate.rgb.shape[:2])]).astype(np.float32)
    layer, below = oiio.ImageBuf(name), oiio.ImageBuf(under)
    below.specmod().alpha_channel = 3
    composites = [
        rgba[..., :3] + (1 - rgba[..., 3:]) * plate.rgb,
        oiio.ImageBufAlgo.over(layer, below).get_pixels(oiio.FLOAT)[..., :3],
    ]
    own = bm.read_layer(name).over(plate).rgb
    for composite in composites:
        assert np.sqrt(np.mean((composite - own) ** 2)) < 10 ** (-70 / 20)
        assert np.sqrt(np.mean((composite - frames[k].rgb) ** 2)) < 1.15 * NOISE


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs POSIX signals")
def test_cluster_that_loses_a_worker_writes_the_same_bytes(shot, once, tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs the `cluster` extra")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as local,
        distributed.Client(local) as client,
        bm.clips.cluster_workers(client, tmp_path) as workers,
    ):
        victim = min(client.run(os.getpid).values())
        for event in bm.save_clip(run_of(shot), tmp_path, workers):
            if isinstance(event, bm.clips.FrameRecord) and victim:
                os.kill(victim, signal.SIGKILL)
                victim = 0
    for name in (*NAMES, "frames.csv", "report.json"):
        assert (tmp_path / name).read_bytes() == (once[0] / name).read_bytes()


@pytest.mark.battery
def test_frames_of_a_thing_without_a_path_have_a_layer_each_or_a_reason(tmp_path):
    """A stick of two paints turns about one end; no disc on a path explains it."""
    y, x = np.indices((120, 160))
    rng = np.random.default_rng(4)
    ground = 0.4 + 0.1 * np.sin(x / 9)[..., None] * [1, 0.5, -1] + 0 * y[..., None]
    covered, noise = [], bm.NoiseModel(read_std=0.003)
    for k in range(8):
        light, whole = np.zeros((120, 160, 3)), np.zeros((120, 160))
        for turn in np.linspace(0.5 * k, 0.5 * k + 0.4, 40):
            u = (x - 80) * np.cos(turn) + (y - 60) * np.sin(turn)
            v = (y - 60) * np.cos(turn) - (x - 80) * np.sin(turn)
            inside = (u > 0) & (u < 50) & (np.abs(v) < 6)
            whole += inside / 40
            light += (inside / 40)[..., None] * np.where(
                (u > 30)[..., None], [0.7, 0.05, 0.05], 0.02
            )
        picture = light + (1 - whole[..., None]) * ground
        covered.append(whole.sum())
        frame = bm.LinearImage(picture + rng.normal(0, 0.003, picture.shape)).with_noise(noise)
        bm.write(tmp_path / f"stick.{k:04d}.exr", frame)
    frames = bm.read_frames(tmp_path / "stick.####.exr")
    plate = bm.LinearImage(ground).with_noise(bm.NoiseModel(read_std=1e-4))
    run = bm.clips.ClipRun((), frames, plate)
    *_, report = bm.save_clip(run, tmp_path / "out", bm.motion.Workers(1))
    assert [record.frame for record in report.records] == list(range(8))
    assert all(record.layer or record.reason for record in report.records)
    layers = [record for record in report.records if record.layer]
    assert len(layers) >= 6
    for record in layers:
        assert abs(record.sum_alpha - covered[record.frame]) < 3 * record.sum_alpha_std


def test_clip_without_a_layer_ends_with_a_report_and_one_reason(shot, tmp_path):
    """Exact: of any color, where nothing moves; a table of an older run is no result of this one."""
    run = run_of(shot)
    run = bm.clips.ClipRun(run.inputs, run.frames[:3], run.plate, bm.ColorModel.any())
    (tmp_path / "frames.csv").write_text("old")
    report = list(bm.save_clip(run, tmp_path, bm.motion.Workers(1)))[-1]
    assert report.problems == ("3 of 3 frames have no layer: nothing moved",)
    assert report.records == ()
    assert json.loads((tmp_path / "report.json").read_text())["problems"] == list(report.problems)
    assert (tmp_path / "overview.png").exists()
    assert not (tmp_path / "frames.csv").exists()
