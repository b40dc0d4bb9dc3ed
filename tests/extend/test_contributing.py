"""The examples of "Add a member" in CONTRIBUTING.md run."""

import ast
import importlib
import re
from pathlib import Path

import numpy as np
import pytest

import blurmatte as bm
from blurmatte import formats

TEXT = (Path(__file__).parents[2] / "CONTRIBUTING.md").read_text(encoding="utf-8")
*MEMBERS, COMMAND = re.findall(r"(?s)```python\n(.*?)```", TEXT)


@pytest.fixture(scope="module")
def names():
    """What the examples define, in their order, for a small ball that moved."""
    ball = bm.rendering.Ball(6, (0.8, 0.25, 0.1))
    plate = bm.rendering.colorful_plate((64, 48), 1, tile=16)
    scene = bm.rendering.Scene(plate, bm.Trajectory.line((18, 20), (44, 27)), ball)
    truth, noise = bm.rendering.render(scene), bm.NoiseModel(read_std=0.004)
    image, plate = (picture.with_noise(noise) for picture in (truth.image, truth.plate))
    known = {"image": image, "plate": plate, "model": truth.model, "answers": []}
    for block in MEMBERS:
        exec(block, known)
        known["answers"].append(known.get("solution"))
    return known


def test_every_family_has_one(names):
    assert len(MEMBERS) == 5
    assert {"Difference", "Cubic", "Washer", "WasherMoved", "PNM"} < set(names)


def test_the_solver_answers(names):
    assert names["answers"][0].solver == "Difference()"


def test_the_noise_is_that_of_the_picture(names):
    light = np.full((1, 1, 3), 0.5)
    assert names["noisy"].noise.variance(light) == pytest.approx(1e-6 + 4e-5 / 8)


def test_the_hypothesis_competes(names):
    assert names["solution"].sweep.silhouette.is_disc
    assert names["solver"].hypotheses[-1] == names["WasherMoved"]()


def test_the_format_can_stand_in_the_list(names):
    assert names["PNM"].one_picture
    assert not formats.named("a.ppm").one_picture


def test_names_that_the_command_imports_exist():
    for node in ast.walk(ast.parse(COMMAND)):
        if isinstance(node, ast.ImportFrom):
            module = importlib.import_module(node.module)
            assert all(hasattr(module, one.name) for one in node.names)
