"""The add-on of Blender, used in an environment with bpy; without one only its archive is checked.

benchmarks/cycles/blender/install makes such an environment; BLURMATTE_BPY names the Python of another.
"""

import json
import os
import shlex
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest
from tests.scenes import rendered
from tests.scripts import loaded

import blurmatte as bm
from blurmatte.rendering import Ball, Scene, colorful_plate
from blurmatte.trajectory import Trajectory

ROOT = Path(__file__).parents[2]
BLENDER = ROOT / "integrations" / "blender"
PYTHON = Path(os.environ.get("BLURMATTE_BPY", ROOT / "benchmarks/cycles/blender/.venv/bin/python"))
SIZE = 96, 64


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    return loaded(BLENDER / "build.py").build(tmp_path_factory.mktemp("archive"))


def test_the_archive_holds_the_addon_and_is_the_same_if_built_again(archive, tmp_path):
    """Exact"""
    again = loaded(BLENDER / "build.py").build(tmp_path)
    assert again.read_bytes() == archive.read_bytes()
    with zipfile.ZipFile(archive) as file:
        names = set(file.namelist())
    assert {"blender_manifest.toml", "__init__.py", "LICENSE"} <= names
    assert not any("/" in name for name in names)


def test_the_manifest_has_the_version_of_the_package_and_the_license():
    manifest = tomllib.loads((BLENDER / "addon/blender_manifest.toml").read_text(encoding="utf-8"))
    assert manifest["version"] == bm.__version__
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert "GNU GENERAL PUBLIC LICENSE" in (BLENDER / "addon/LICENSE").read_text(encoding="utf-8")
    for path in BLENDER.rglob("*.py"):
        assert path.read_text(encoding="utf-8").startswith("# SPDX-License-Identifier: GPL-3.0-or-")


def test_the_addon_imports_nothing_of_the_package():
    """Exact: its Python is another, and its license too."""
    for path in (BLENDER / "addon").glob("*.py"):
        assert "import blurmatte" not in path.read_text(encoding="utf-8")
        assert "from blurmatte" not in path.read_text(encoding="utf-8")


def test_a_run_of_the_command_can_be_followed_and_stopped(tmp_path):
    """Exact: the last line is the stage; what it started ends with it."""
    running = loaded(BLENDER / "addon" / "running.py")
    fake = tmp_path / "blurmatte"
    code = (
        "import sys, time; print('blurmatte: 0.1 s: x',file=sys.stderr,flush=True); time.sleep(60)"
    )
    fake.write_text(f"#!/bin/sh\n{shlex.quote(sys.executable)} -c {shlex.quote(code)}\n")
    fake.chmod(0o755)
    run = running.Run(running.found_command(str(fake)), ["solve"])
    while not run.stage.startswith("x ("):
        assert run.code is None
    run.cancel()
    assert run.code is not None
    assert run.code not in running.ANSWERED
    with pytest.raises(FileNotFoundError, match="there is no command /nowhere: install blurmatte"):
        running.found_command("/nowhere")


@pytest.fixture(scope="module")
def used(archive, tmp_path_factory):
    """The folder in which a user worked, and what the add-on did."""
    if not PYTHON.is_file():
        pytest.skip(f"Blender is not there: benchmarks/cycles/blender/install makes {PYTHON}")
    folder = tmp_path_factory.mktemp("blender")
    plate = colorful_plate(SIZE, rng=1, tile=9).astype(np.float32)
    path = Trajectory.arc((22, 40), (45, 24), (70, 30))
    scene = Scene(plate.astype(float), path, Ball(8, (0.9, 0.5, 0.05)))
    image = rendered(scene).image.rgb
    noise = np.random.default_rng(0).normal(0, 2e-3, image.shape)
    bm.write(folder / "image.exr", bm.LinearImage((image + noise).astype(np.float32)))
    bm.write(folder / "plate.exr", bm.LinearImage(plate))
    (folder / "clip").mkdir()
    for number in range(3, 6):
        box = np.zeros(SIZE[::-1], np.float32)
        box[10:20, 10 * number : 10 * number + 8] = 0.5
        layer = bm.Layer(box, box[..., None] * np.float32([0.8, 0.1, 2.0]))
        bm.write(folder / "clip" / f"layer.{number:06}.exr", layer)
    command = folder / "blurmatte"
    source = shlex.quote(str(ROOT / "src"))
    command.write_text(
        f'#!/bin/sh\nPYTHONPATH={source} exec {shlex.quote(sys.executable)} -m blurmatte "$@"\n'
    )
    command.chmod(0o755)
    home = {"HOME": str(folder), "BLENDER_USER_RESOURCES": str(folder / "user")}
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")} | home
    asked = [str(PYTHON), "check.py", str(archive), str(command), str(folder)]
    done = subprocess.run(
        asked, cwd=BLENDER, env=environment, capture_output=True, text=True, check=False
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("FOUND ")]
    assert lines, done.stdout[-3000:] + done.stderr[-3000:]
    return folder, json.loads(lines[-1].removeprefix("FOUND "))


@pytest.mark.battery
def test_blender_finds_the_archive_valid(archive):
    if not PYTHON.is_file():
        pytest.skip(f"Blender is not there: benchmarks/cycles/blender/install makes {PYTHON}")
    tools = sorted(PYTHON.parents[1].rglob("bl_pkg/cli/blender_ext.py"))
    asked = [str(PYTHON), str(tools[-1]), "validate", str(archive)]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.battery
def test_a_user_gets_from_the_archive_to_a_composite(used):
    """Exact: Alpha Over is `over`, and the panel shows grade and alternatives."""
    folder, found = used
    assert found["installed"]
    assert found["panels"] == [True, True]
    assert found["solved"] == found["again"] == ["FINISHED"]
    assert found["plate"] == "plate.exr"
    report = json.loads((folder / "out" / "report.json").read_text())
    assert found["said"] == report["in_words"]
    assert found["said"][0].startswith(report["stats"]["grade"])
    assert found["render"] == list(SIZE)
    layer, plate = bm.read_layer(folder / "out" / "layer.exr"), bm.read(folder / "plate.exr")
    composed = bm.read(folder / "composite.exr").rgb
    np.testing.assert_allclose(composed, layer.over(plate).rgb, atol=1e-5, rtol=0)
    assert not found["left"]


@pytest.mark.battery
def test_the_curve_is_the_path(used):
    """Exact: within 0.1 pixel of the trajectory, by a camera that is turned and shifted."""
    folder, found = used
    motion = bm.measure_motion(bm.read_solution(folder / "out" / "layer.exr"))
    path = motion.trajectory
    np.testing.assert_allclose(found["path"]["curve"], path.xy, atol=0.1, rtol=0)
    opened = path.at(np.array([0, 0.5, 1]))  # the shutter is open for half a frame
    np.testing.assert_allclose(found["path"]["marker"], opened, atol=0.1, rtol=0)


@pytest.mark.battery
def test_the_plane_fills_the_view_with_the_light_of_the_layer(used):
    """Exact corners; the light as Cycles samples it."""
    folder, found = used
    right, bottom = SIZE[0] - 0.5, SIZE[1] - 0.5
    corners = [[-0.5, bottom], [right, bottom], [right, -0.5], [-0.5, -0.5]]
    np.testing.assert_allclose(found["plane"], corners, atol=0.01)
    light = bm.read_layer(folder / "out" / "layer.exr").premultiplied
    seen = bm.read(folder / "plane.exr").rgb
    assert abs(seen.sum() / light.sum() - 1) < 0.02
    assert np.sqrt(np.mean((seen - light) ** 2)) < 0.1 * light.max()


@pytest.mark.battery
def test_a_clip_is_a_sequence_with_the_right_first_frame(used):
    """Exact: frame 0 of the clip is frame 11 of the scene, so that layer 4 is in frame 15."""
    folder, found = used
    assert found["clip"]["placed"] == ["FINISHED"]
    assert found["clip"]["frames"][0] == 3
    plate = bm.read(folder / "plate.exr")
    for frame, number in ((15, 4), (16, 5)):
        layer = bm.read_layer(folder / "clip" / f"layer.{number:06}.exr")
        composed = bm.read(folder / f"clip_{frame}.exr").rgb
        np.testing.assert_allclose(composed, layer.over(plate).rgb, atol=1e-5, rtol=0)
    ours = [name for name in found["clip"]["nodes"] if name.startswith("blurmatte")]
    assert ours == ["blurmatte layer", "blurmatte over", "blurmatte plate"]


@pytest.mark.battery
def test_what_cannot_be_solved_is_refused_in_a_line(used):
    """door."""
    _, found = used
    without, two, command, missing = found["refused"]
    assert "which of them is the plate?" in without
    assert "which of them is the plate?" in two
    assert "there is no command /nowhere/blurmatte" in command
    assert "missing.exr" in missing
    assert all(len(said.splitlines()) == 1 for said in found["refused"])
