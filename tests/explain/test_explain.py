"""explain: which objects it accepts."""

import numpy as np
import pytest

from blurmatte.color.model import ColorModel
from blurmatte.explain import explain


def test_rejects_other_types():
    with pytest.raises(TypeError, match="got int"):
        explain(3)


def test_given_color_is_named():
    assert explain(ColorModel.from_hex("#ff0000")) == [
        "One paint and its shades: all multiples of the linear RGB color (1.000, 0.000, 0.000).",
        "The color was given, not measured.",
    ]
    assert explain(ColorModel.from_hex("#ff0000", "#0000ff"))[0].startswith("Two paints")


def test_any_colors_are_named():
    (said,) = explain(ColorModel.any())
    assert "shape" in said


def test_range_of_possible_colors_is_named():
    basis = ColorModel.from_hex("#d8a03c").basis
    covariance = 0.02**2 * (np.eye(3) - basis @ basis.T)
    said = explain(ColorModel(basis, covariance, {"shape": 1.1}))[-1]
    assert said.startswith("In 95 of 100 cases no further away than #")
    assert len(explain(ColorModel(basis, covariance * 1e-9, {"shape": 1e-4}))) == 2


def test_accuracy_of_each_evidence_is_stated():
    given = ColorModel.from_hex("#ff0000")
    evidence = {"hue variation": 0.123, "feasibility": np.inf, "shape": 2.0}
    model = ColorModel(given.basis, np.eye(3) * 1e-4, evidence)
    assert explain(model)[1:4] == [
        "From the hues of the plate behind the streak alone: to 0.12°.",
        "From alpha between 0 and 1, and no negative light, alone: nothing.",
        "From the shape of the streak and the hues together: to 2°.",
    ]
