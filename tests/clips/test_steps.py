"""The steps through a clip: what is computed once, what is resumed, and what the log says."""

import logging
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from tests.clips.conftest import COLOR, COUNT, FIRST, LAST, NOISE

import blurmatte as bm
from blurmatte.matting import Pixelwise
from blurmatte.motion.clip.steps import ClipInputs, ClipMeasured, measured, solved, whole
from blurmatte.streaks import Gate

MODEL = bm.ColorModel(COLOR[:, None] / np.linalg.norm(COLOR))


@pytest.fixture(scope="module")
def clip(pictures):
    frames, plate = pictures
    frames = [frame.with_noise(bm.NoiseModel(read_std=NOISE)) for frame in frames]
    return ClipInputs(frames, plate.with_noise(bm.NoiseModel(read_std=1e-4)), MODEL)


@pytest.fixture(scope="module")
def events(clip):
    """All that comes of the clip."""
    return list(measured(clip, bm.motion.Workers(1)))


@pytest.mark.parametrize("model", [None, MODEL], ids=["color found", "color given"])
def test_each_frame_is_compared_with_the_plate_once(clip, model, monkeypatch):
    """Exact: though its color is voted for, it is measured, and solved."""
    compared, real = Counter(), Gate.changes

    def counted(self, frame):
        compared[frame.planes[0].tobytes()] += 1
        return real(self, frame)

    monkeypatch.setattr(Gate, "changes", counted)
    with bm.motion.Workers(1) as workers:
        found = whole(measured(replace(clip, model=model), workers))
        assert sum(row.sighting is not None for row in found.rows) == LAST - FIRST + 1
        layers = list(solved(found, workers, Pixelwise(), lambda each: each))
    assert all(isinstance(layer, bm.Solution) for _, layer in layers)
    assert len(layers) == LAST - FIRST + 1
    assert len(compared) == COUNT
    assert set(compared.values()) == {1}


def test_finished_frames_are_not_measured_again(clip, events):
    """Exact: the same table from five finished frames, which are not yielded."""
    *seen, last = events
    *rest, resumed = measured(replace(clip, finished=seen[:5]), bm.motion.Workers(1))
    assert [one.frame for one in rest] == list(range(5, COUNT))
    assert isinstance(resumed, ClipMeasured)
    assert [row.numbers() for row in resumed.rows] == [row.numbers() for row in last.rows]


def test_nothing_is_found_again_if_all_solutions_exist(clip, events):
    """Exact: neither scene nor color; one that is missing needs both."""
    *seen, last = events
    places = {row.place for row in last.rows if row.sighting is not None}
    done = replace(clip, finished=seen, written=places)
    found = [
        whole(measured(one, bm.motion.Workers(1))) for one in (done, replace(done, written=set()))
    ]
    assert [one.scene is None for one in found] == [True, False]
    assert [one.model for one in found] == [None, MODEL]


def test_log_says_how_many_frames_are_measured(clip, caplog):
    with caplog.at_level(logging.INFO, "blurmatte"):
        whole(measured(replace(clip, frames=clip.frames[:4]), bm.motion.Workers(1)))
    said = [message for message in caplog.messages if message.startswith("measuring: ")]
    assert [one.split(",")[0] for one in said] == [f"measuring: {k} of 4" for k in range(1, 5)]
    assert said[-1].endswith("0 s remain")
