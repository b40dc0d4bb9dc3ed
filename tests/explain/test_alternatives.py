"""Sentences about alternatives."""

import pytest

from blurmatte.explain import alternatives_in_words, alternatives_of, explain
from blurmatte.matting import Grade
from blurmatte.matting.alternatives import Alternative

OWN = {
    "name": "disc on an arc, one paint",
    "rgb": (0.4, 0.1, 0.02),
    "hex": "#aa5a27",
    "weight": 0.9,
    "alpha_factor": 1.0,
    "alpha_difference": 0.0,
    "radius": 8.0,
}
LIKELY = {**OWN, "name": "no shape, one paint", "hex": "#a04020", "alpha_factor": 1.3,
          "weight": 0.1, "radius": None}  # fmt: skip
UNLIKELY = {**OWN, "name": "ellipse on a cubic curve, two paints", "hex": "#905030",
            "alpha_factor": 0.7, "weight": 0.0}  # fmt: skip
BOTH = Alternative(**OWN), Alternative(**LIKELY)


def graded(solution, *alternatives, scale=0.2):
    found = tuple(Alternative(**one) for one in alternatives)
    return solution(grade=Grade.ASSUMED, alpha_scale_std=scale, alternatives=found)


def test_colors_factors_and_interval(solution):
    """exact"""
    found = graded(solution, OWN, LIKELY, UNLIKELY)
    also, interval = alternatives_in_words(found)
    assert also == (
        "also fits: #a04020 with alpha x 1.30 (no shape, one paint); fits less well: #905030 with "
        "alpha x 0.70 (ellipse on a cubic curve, two paints)"
    )
    assert interval == (
        "all of alpha may be 0.70 to 1.30 times as large: 0.80 to 1.20 by one standard deviation, "
        "0.70 to 1.30 over the hypotheses"
    )
    _, *said = explain(found)
    assert said[:2] == [f"{line[0].upper()}{line[1:]}." for line in (also, interval)]


def test_interval_of_a_large_error_ends_at_zero(solution):
    """exact"""
    (interval,) = alternatives_in_words(graded(solution, OWN, scale=1.5))
    assert interval == (
        "all of alpha may be 0.00 to 2.50 times as large: 0.00 to 2.50 by one standard deviation"
    )


def test_equal_hypotheses_are_listed_but_not_named(solution):
    """exact"""
    same = {**LIKELY, "alpha_factor": 1.01, "alpha_difference": 0.004}
    found = graded(solution, OWN, same)
    assert len(alternatives_of(found)) == 2
    assert [line.split(":")[0] for line in alternatives_in_words(found)] == [
        "all of alpha may be 0.80 to 1.20 times as large"
    ]


@pytest.mark.parametrize(
    "stats",
    [
        {"grade": Grade.CONFIRMED, "alternatives": BOTH, "alpha_scale_std": 0.01},
        {"grade": Grade.ASSUMED, "alpha_scale_std": 0.2},
        {"alternatives": BOTH},
    ],
    ids=["confirmed", "none compared", "no grade"],
)
def test_solutions_without_alternatives_have_no_sentence(solution, stats):
    assert alternatives_in_words(solution(**stats)) == []
