"""Scale and Speed: meters per second, their errors, and the rolling shutter."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from blurmatte.checks import DIRECTIONS
from blurmatte.errors import MotionError
from blurmatte.motion import Motion
from blurmatte.motion.picture.motion import QUANTITIES, Scale
from blurmatte.trajectory import Trajectory

MPH = 1609.344 / 3600
STDS = {"length": 0.3, "radius": 0.05, "top_speed": 0.3}


def motion_of(trajectory, radius=10.0, size=(640, 480), shared=0.0, **more):
    """A Motion of this path; the errors of length and radius have the correlation `shared`."""
    chord = trajectory.xy[-1] - trajectory.xy[0]
    speeds = np.linalg.norm(np.diff(trajectory.xy, axis=0), axis=1) / np.diff(trajectory.t)
    length = trajectory.length
    values = [*trajectory.at(0.5), np.arctan2(chord[1], chord[0]), length, 2 * radius, radius]
    values += [np.pi * radius**2, speeds.max()]
    covariance = np.zeros((8, 8))
    for name, std in STDS.items():
        covariance[QUANTITIES.index(name), QUANTITIES.index(name)] = std**2
    r = QUANTITIES.index("radius")
    for name in ("length", "top_speed"):
        i = QUANTITIES.index(name)
        covariance[i, r] = covariance[r, i] = shared * STDS[name] * STDS["radius"]
    return Motion(
        trajectory,
        np.array(values),
        covariance,
        speeds,
        np.full(len(speeds), 0.3),
        "sweep",
        "line",
        "disc",
        size,
        **more,
    )


LINE = motion_of(Trajectory.line((100, 100), (220, 190)))  # 150 px


def test_speed_in_all_units():
    """Exact: 150 px of 2 mm in 1/50 s are 15 m/s."""
    speed = LINE.speed(Scale(0.002), 0.02)
    assert (speed.mean, speed.top, speed.unit) == (pytest.approx(15), pytest.approx(15), "m/s")
    assert speed.in_unit("km/h").mean == pytest.approx(54)
    assert speed.in_unit("mph").mean == pytest.approx(15 / MPH)
    assert speed.in_unit("mph").in_unit("m/s").mean_std == pytest.approx(speed.mean_std)
    assert speed.mean_std == pytest.approx(15 * 0.3 / 150)


@pytest.mark.parametrize(
    ("scale", "time", "value", "unit"),
    [
        (None, None, 150, "px/exposure"),
        (None, 0.02, 7500, "px/s"),
        (Scale(0.002), None, 0.3, "m/exposure"),
    ],
)
def test_unit_without_scale_or_time(scale, time, value, unit):
    """Exact: the unit is that of what is known, and meters per second are refused."""
    speed = LINE.speed(scale, time)
    assert (speed.mean, speed.unit) == (pytest.approx(value), unit)
    with pytest.raises(MotionError, match=f"known in {unit} only; give "):
        speed.in_unit("km/h")


def test_exposure_time_of_image_is_default():
    """Exact."""
    assert replace(LINE, exposure_time=0.02).speed().mean == pytest.approx(7500)


def test_parts_of_the_error():
    """Exact: each part alone, and the root of the sum of their squares."""
    speed = LINE.speed(Scale(0.002, 0.00002), 0.02, exposure_std=0.001)
    assert speed.parts == pytest.approx({"length": 0.002, "scale": 0.01, "exposure time": 0.05})
    assert speed.dominant == "exposure time"
    assert speed.mean_std / speed.mean == pytest.approx(np.sqrt(0.002**2 + 0.01**2 + 0.05**2))


@pytest.mark.parametrize("shared", [-0.6, 0, 0.6])
def test_error_includes_correlation_of_length_and_radius(shared):
    """Honest: length over radius of draws from the covariance."""
    motion = motion_of(LINE.trajectory, shared=shared)
    scale = Scale.from_radius(motion, 0.02, 0.0001)
    speed, rng = motion.speed(scale, 0.02), np.random.default_rng(0)
    names = [QUANTITIES.index(name) for name in ("length", "radius")]
    draws = rng.multivariate_normal(
        motion.values[names], motion.covariance[np.ix_(names, names)], 20000
    )
    radii = 0.02 + 0.0001 * rng.normal(size=len(draws))
    seen = draws[:, 0] * radii / draws[:, 1] / 0.02
    assert speed.mean_std == pytest.approx(seen.std(), rel=0.03)
    assert speed.top_std == pytest.approx(seen.std(), rel=0.03)


def test_scale_from_radius_and_points():
    """Exact: from a radius, and from two points 500 px apart."""
    assert Scale.from_radius(LINE, 0.02).meters_per_pixel == pytest.approx(0.002)
    assert Scale.from_radius(LINE, 0.02).std == pytest.approx(0.002 * 0.005)
    scale = Scale.from_points((0, 0), (300, 400), 1.0, 0.01)
    assert (scale.meters_per_pixel, scale.std) == (pytest.approx(0.002), pytest.approx(2e-5))


def seen_through(place, T, tau, count=201):
    """Oracle: the image of a point on a path (seconds → (x, y)) at each exposure fraction."""
    xy = []
    for s in np.linspace(0, 1, count):
        row = brentq(lambda y, s=s: place(s * T + tau * y)[1] - y, -1e4, 1e4)
        xy.append(place(s * T + tau * row))
    return Trajectory(np.array(xy), np.linspace(0, 1, count))


@pytest.mark.parametrize("velocity", [(3000.0, 2000.0), (3000.0, -2000.0), (500.0, 4000.0)])
def test_rolling_shutter_is_corrected_on_lines(velocity):
    """Oracle: the row of a point, found by bisection, gives its time."""
    T, tau, v = 0.02, 3e-5, np.array(velocity)
    motion = motion_of(seen_through(lambda t: np.array([100, 200]) + v * t, T, tau))
    down = velocity[1] > 0
    speed = motion.speed(None, T, line_time=tau, going="down" if down else "up")
    assert speed.mean == pytest.approx(np.hypot(*v), rel=1e-6)
    assert speed.top == pytest.approx(np.hypot(*v), rel=1e-4)
    assert abs(motion.speed(None, T).mean / np.hypot(*v) - 1) > 0.02  # else the test has no power
    both = motion.speed(None, T, line_time=tau)
    assert abs(both.mean - np.hypot(*v)) < 1.2 * both.mean_std
    assert both.dominant == "direction of time"


@pytest.mark.parametrize("readout", ["up", "left", "right"])
def test_rows_of_turned_files_are_those_of_the_sensor(readout):
    """Invariant: a turned picture has the same speed as one whose rows go down."""
    T, tau, v = 0.02, 3e-5, np.array([3000.0, 2000.0])
    seen = seen_through(lambda t: np.array([100, 200]) + v * t, T, tau)
    e = np.array(DIRECTIONS[readout])
    turn = np.column_stack([(e[1], -e[0]), e])  # takes down to e
    turned = motion_of(Trajectory(seen.xy @ turn.T, seen.t), readout=readout)
    going = next(name for name, to in DIRECTIONS.items() if tuple(turn @ (1, 0)) == to)
    speed = turned.speed(None, T, line_time=tau, going=going)
    assert speed.mean == pytest.approx(np.hypot(*v), rel=1e-6)
    assert abs(replace(turned, readout="down").speed(None, T, line_time=tau, going=going).mean
               / np.hypot(*v) - 1) > 0.02  # fmt: skip
    rows = 640 if e[0] else 480
    crossed = abs((seen.xy[-1] - seen.xy[0])[1])
    assert turned.speed(None, T).unknown == pytest.approx(crossed / rows)
    assert turned.speed(None, T).readout == readout


def test_direction_across_the_path_does_not_determine_its_time():
    """Exact: both directions count."""
    level = motion_of(Trajectory.line((100, 200), (300, 200)), readout="right")
    known, unknown, across = (
        level.speed(None, 0.02, line_time=1e-5, going=g) for g in ("right", None, "down")
    )
    assert across.mean_std == unknown.mean_std > 2 * known.mean_std
    with pytest.raises(ValueError, match="going must be one of right, down, left, up, got 'away'"):
        level.speed(None, 0.02, line_time=1e-5, going="away")


def test_rolling_shutter_is_corrected_on_parabola():
    """Oracle: mean speed and top speed of a path with an acceleration."""
    T, tau = 0.02, 2e-5

    def place(t):
        return np.array([50 + 6000 * t, 300 - 4000 * t + 1e5 * t * t])

    motion = motion_of(seen_through(place, T, tau, 2001))
    speed = motion.speed(None, T, line_time=tau, going="up")
    rows = motion.trajectory.xy[:, 1]
    first, last = tau * rows[0], T + tau * rows[-1]
    times = np.linspace(first, last, 5001)
    true = np.hypot(6000, -4000 + 2e5 * times)
    assert speed.mean == pytest.approx(true.mean(), rel=1e-4)
    assert speed.top == pytest.approx(true.max(), rel=1e-3)


@pytest.mark.parametrize("v_y", [4000.0, -4000.0])
def test_rolling_shutter_stretches_the_area(v_y):
    """Oracle: alpha of a disc, each row exposed at its own time."""
    T, tau, radius, v = 0.02, 3e-5, 14.0, np.array([1500.0, v_y])
    y, x = np.indices((240, 160)).astype(float)
    alpha = np.zeros_like(x)
    for s in (np.arange(200) + 0.5) / 200:
        t = s * T + tau * y
        away = np.hypot(x - 60 - v[0] * t, y - (60 if v_y > 0 else 180) - v[1] * t)
        alpha += np.clip(radius + 0.5 - away, 0, 1) / 200
    stretched = 1 / (1 - v[1] * tau)
    assert alpha.sum() == pytest.approx(np.pi * radius**2 * stretched, rel=2e-3)
    path = Trajectory.line((0, 200), (0, 200) + v * T * stretched)
    motion = motion_of(path, radius * np.sqrt(stretched))
    scale = Scale.from_radius(motion, 0.001 * radius)
    speed = motion.speed(scale, T, line_time=tau, going="down" if v_y > 0 else "up")
    assert speed.mean == pytest.approx(0.001 * np.hypot(*v), rel=1e-6)


def test_unknown_effect_of_usual_rolling_shutter():
    """Exact: 90 rows of 480, read in 20 ms, in an exposure of 20 ms."""
    assert LINE.speed(None, 0.02).unknown == pytest.approx(90 / 480)
    assert LINE.speed(None, 0.02, line_time=0).unknown == 0
    assert LINE.speed().unknown is None


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: Scale(0), "meters_per_pixel must be finite and above 0, got 0"),
        (lambda: Scale(1, -1), "std must be finite and not negative"),
        (lambda: Scale.from_radius(LINE, -1), "radius must be finite and above 0"),
        (lambda: Scale.from_points((1, 2), (1, 2), 1), "the two points must differ"),
        (lambda: Scale.from_points((1, 2, 3), (1, 2), 1), r"a point must be \(x, y\)"),
        (lambda: LINE.speed(None, 0), "exposure_time must be finite and above 0"),
        (lambda: LINE.speed(line_time=1e-5), "line_time needs exposure_time"),
        (lambda: LINE.speed(None, 1e-4, line_time=1e-4, going="up"), "check line_time"),
        (lambda: LINE.speed(None, 1, line_time=15e-3), "no camera takes more than 1 s to read"),
        (lambda: LINE.speed(Scale(1), 1).in_unit("knots"), "unit must be m/s or km/h or mph"),
    ],
)
def test_invalid_input_is_rejected(call, match):
    """Door."""
    with pytest.raises(ValueError, match=match):
        call()


def test_uncertain_radius_gives_no_scale():
    """Door."""
    motion = motion_of(LINE.trajectory, radius=0.1)
    with pytest.raises(MotionError, match="gives no scale"):
        Scale.from_radius(motion, 0.02)
    cut = replace(LINE, source="moments", at_border=True)
    with pytest.raises(MotionError, match="reaches the border"):
        Scale.from_radius(cut, 0.02)


def test_reversed_motion_has_the_same_speed():
    """Invariant: for an unknown direction of time."""
    forth, back = (m.speed(Scale.from_radius(LINE, 0.02), 0.02, line_time=1e-5)
                   for m in (LINE, LINE.reversed))  # fmt: skip
    assert_allclose([back.mean, back.mean_std], [forth.mean, forth.mean_std])
