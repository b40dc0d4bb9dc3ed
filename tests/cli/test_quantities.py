import pytest

from blurmatte.cli.quantities import frame_range

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
