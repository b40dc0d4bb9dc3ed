"""explain: sentences about a Motion and a Speed."""

from dataclasses import replace

import numpy as np
import pytest

import blurmatte as bm
from blurmatte.color.model import ColorModel
from blurmatte.explain import explain
from blurmatte.explain.motion import spin_in_words
from blurmatte.explain.numbers import direction
from blurmatte.motion.picture.measure import motion_of_sweep
from blurmatte.motion.picture.motion import Scale
from blurmatte.sweep import Sweep
from blurmatte.sweep.model.path import path_family
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE

LINE = ("line", [20, 30, 70, 42])


def motion_of(name, path, silhouette=DISC, std=0.05, at_border=False):
    shape = silhouette.start(9.0)
    covariance = std**2 * np.eye(len(path) + len(shape))
    family, model = path_family(name), ColorModel.from_hex("#d8ff3c")
    sweep = Sweep(family, np.array(path, float), silhouette, shape, model, covariance, (96, 72))
    return replace(motion_of_sweep(sweep, 0.02), at_border=at_border)


@pytest.mark.parametrize(
    ("motion", "said"),
    [
        (motion_of(*LINE), "a disc on a straight line at constant speed"),
        (motion_of(*LINE, ELLIPSE), "an ellipse on a straight line"),
        (motion_of(*LINE), "or the opposite one: one picture does not determine which"),
        (motion_of(*LINE, at_border=True), "It went at least 51.4"),
        (motion_of(*LINE, at_border=True), "the length is a lower bound"),
        (motion_of("from rest", [20, 30, 70, 42, 0.3], std=0.02), "at rest for 30% ± 2.0%"),
        (motion_of("parabola", [20, 30, 48, 20, 70, 42]), "velocity changed by x -24.0"),
        (motion_of("parabola", [20, 30, 48, 20, 70, 42]), "Its speed was between"),
        (
            motion_of("line", [45, 36, 45.1, 36]),
            "it may have been at rest; its direction is unknown",
        ),
        (
            replace(motion_of("line", [45, 36, 45.1, 36]), doubts=("The fit did not converge.",)),
            "is not significant; for the reason above this does not mean that it was at rest",
        ),
        (replace(motion_of(*LINE), source="moments"), "are not known without a shape"),
        (replace(motion_of(*LINE), doubts=("It is two things.",)), "It is two things."),
    ],
)
def test_motion_in_words(motion, said):
    """Exact."""
    assert said in " ".join(explain(motion))


def test_rest_is_not_stated_of_a_doubtful_fit():
    """Exact: nor of a long path."""
    doubted = replace(motion_of("line", [45, 36, 45.1, 36]), doubts=("It is two things.",))
    for motion in (doubted, motion_of(*LINE, std=3.0)):
        assert "may have been at rest" not in " ".join(explain(motion))


def test_motion_in_words_omits_what_does_not_apply():
    """Exact: no border, rest or changing speed on a line."""
    words = " ".join(explain(motion_of(*LINE)))
    for said in ("lower bound", "at rest", "between", "moments"):
        assert said not in words


@pytest.mark.parametrize(
    ("speed", "said"),
    [
        (motion_of(*LINE).speed(Scale(0.002)), "Mean speed 5.1"),
        (motion_of(*LINE).speed(Scale(0.002, 0.0002)), "largest first: scale 10 %, length 0."),
        (motion_of(*LINE).speed(Scale(0.002, 0.0024)), "largest first: scale 120 %, length 0."),
        (motion_of(*LINE).speed(), "the scale is missing for meters per second"),
        (replace(motion_of(*LINE), exposure_time=None).speed(), "scale and the exposure time are"),
        (motion_of(*LINE).speed(), "rolling shutter that takes 20 ms"),
        (
            motion_of(*LINE).speed(),
            "too large for a motion down in the picture, too small for one up",
        ),
        (
            replace(motion_of(*LINE), readout="left").speed(exposure_time=0.1),
            "too large for a motion to the left in the picture, too small for one to the right",
        ),
        (motion_of(*LINE).speed(exposure_time=1e-4), "the speed may be entirely different"),
        (motion_of(*LINE).speed(line_time=1e-5), "direction of time"),
    ],
)
def test_speed_in_words(speed, said):
    """Exact."""
    assert said in " ".join(explain(speed))


def test_no_line_time_is_requested_if_given():
    """Exact."""
    assert "rolling" not in " ".join(explain(motion_of(*LINE).speed(line_time=0)))


@pytest.mark.parametrize(
    ("degrees", "said"),
    [
        (0, "0° from right towards down (right)"),
        (40, "40° from right towards down (right and down)"),
        (90, "90° from right towards down (down)"),
        (135, "135° from right towards down (left and down)"),
        (180, "180° from right towards down (left)"),
        (-179, "179° from right towards up (left)"),
        (-135, "135° from right towards up (left and up)"),
        (-90, "90° from right towards up (up)"),
        (-46, "46° from right towards up (right and up)"),
    ],
)
def test_direction_names_its_octant(degrees, said):
    """Exact: y is down."""
    assert direction(degrees) == said


def test_path_upward_points_up():
    """Exact: at −31°."""
    said = " ".join(explain(motion_of("line", [20, 60, 70, 30])))
    assert "° from right towards up (right and up), or the opposite one" in said


def test_a_spin_in_words():
    spin = bm.deblurring.Spin(np.array([0.0, np.radians(36.0), 0.0]), covariance=1e-4 * np.eye(11))
    said = spin_in_words(spin, 0.02)
    assert "spin 36.0 ± 0.6° per exposure, 5.00 ± 0.08 revolutions per second," in said
    assert "about the axis (0.00 right, 1.00 down, 0.00 towards the camera) ± 1.3°" in said
    assert "per second" not in spin_in_words(spin)
