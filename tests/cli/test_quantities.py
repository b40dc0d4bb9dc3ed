import pytest

from blurmatte.cli.quantities import frame_range, length, meters_per_second, time_of_exposure

TIMES = [0.0, 0.033, 0.067, 0.4, 0.533, 0.667, 0.8, 0.933, 1.067]


@pytest.mark.parametrize(
    ("text", "chosen"),
    [
        ("0.6s:1s", [0.667, 0.8, 0.933]),
        ("0.4s:", TIMES[3:]),
        (":0.0667s", TIMES[:2]),
        ("2:4", TIMES[2:4]),
        ("0.1s:0.3s", []),
        ("::4", TIMES[::4]),
    ],
)
def test_seconds_are_those_of_the_frames(text, chosen):
    # exact: at any rate, START included and STOP excluded
    assert TIMES[frame_range("--frames", text, TIMES)] == chosen


def test_numbers_are_those_of_the_names():
    # exact: 4, 5 and 9 are missing
    places = [0, 1, 2, 3, 6, 7, 8, 10]
    assert places[frame_range("--frames", "5:9", None, places)] == [6, 7, 8]


def test_pictures_have_no_seconds():
    # door
    with pytest.raises(ValueError, match="pictures have no times"):
        frame_range("--frames", "1s:", None)


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (length, "4"),
        (length, "4cm±0.1"),
        (time_of_exposure, "60"),
        (time_of_exposure, "0.004"),
        (time_of_exposure, "1/60±0.001"),
        (meters_per_second, "12"),
    ],
)
def test_bare_numbers_are_refused_with_an_example(read, text):
    """door: 4 is no 4 m, and 60 no 60 s."""
    with pytest.raises(ValueError, match=r"like (4cm|1/60|12m/s).* has no unit"):
        read("--x", text)


@pytest.mark.parametrize(
    ("read", "text", "right"),
    [
        (length, "4cm±0.1mm", (0.04, 1e-4)),
        (length, "4cm±0", (0.04, 0)),
        (time_of_exposure, "1/60", (1 / 60, 0)),
        (time_of_exposure, "1/60±1/6000", (1 / 60, 1 / 6000)),
        (meters_per_second, "36km/h", (10, 0)),
    ],
)
def test_quantities_with_units_are_read(read, text, right):
    """exact: a fraction is one of a second, and 0 needs no unit."""
    assert read("--x", text) == pytest.approx(right)
