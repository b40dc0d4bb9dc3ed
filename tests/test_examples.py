"""The examples in the docstrings of public names run, and print what they say."""

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SPEC = importlib.util.spec_from_file_location("examples", ROOT / "docs" / "_site" / "examples.py")
examples = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(examples)

# Take more than half a CPU second; `scripts/battery` runs them
SLOW = {
    "Swept",
    "background.PlateGuess",
    "background.guess_plate",
    "background.regions_that_stand_out",
    "calibration.ResponseFit",
    "calibration.fit_response",
    "clips.ClipReport",
    "deblurring.fit_psf",
    "figures.draw_clip",
    "figures.draw_noise",
    "figures.draw_response",
    "fit_color",
    "matting.Averaged",
    "motion.Workers",
    "motion.clip_color",
    "motion.fit_ball",
    "motion.fit_balls",
    "motion.measure_rotation",
    "read_transfer",
    "save_clip",
    "scenes.read_shots",
    "scenes.save_shot",
    "solve_clip",
    "sweep.MotionPrior",
    "sweep.fit_sweep",
    "sweep.fit_transfer",
}
# A server; half a minute; packages that are no requirement; three minutes
SKIPPED = {
    "clips.cluster_workers",
    "deblurring.fit_spin",
    "results.to_table",
    "results.to_xarray",
    "scenes.save_archive",
}


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """What every example begins with, and the folder with its files."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("examples"))
        yield examples.begin()


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.battery if name in SLOW else ())
        for name in examples.NAMES
    ],
)
def test_examples_print_what_they_say(name, names):
    assert examples.run(name, names) == ""


@pytest.mark.parametrize("name", examples.NAMES)
def test_public_names_have_examples(name):
    assert examples.example(name)


def test_only_examples_that_need_more_are_skipped():
    flag = examples.doctest.SKIP
    skipped = {
        name
        for name in examples.NAMES
        if any(one.options.get(flag) for one in examples.example(name))
    }
    assert skipped == SKIPPED


@pytest.mark.parametrize(
    ("stated", "found", "agree"),
    [
        ("314 ± 3 pixels", "320 ± 2 pixels", True),
        ("314 ± 3 pixels", "350 ± 3 pixels", False),
        ("0.34", "0.36", True),
        ("0.34", "0.37", False),
        ("disc 10", "square 10", False),
        ("1e-05", "4e-05", False),
    ],
)
def test_numbers_agree_to_a_twentieth_or_two_units_of_the_last_digit(stated, found, agree):
    assert examples._Checker().check_output(stated, found, 0) is agree
