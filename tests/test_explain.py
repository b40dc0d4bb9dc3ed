from dataclasses import replace

import numpy as np
import pytest

from blurmatte.color import ColorModel
from blurmatte.explain import doubts, explain
from blurmatte.matting import Quality, Solution
from blurmatte.radiometry import SRGB, NoiseFit, NoiseModel, ResponseFit, Transfer


def solution(**stats):
    alpha = np.full((20, 30), 0.3)
    light = np.ones((20, 30, 3))
    quality = np.full((20, 30), Quality.OUTSIDE, np.uint8)
    quality[5:15, 5:25] = 0
    quality[5, 5:25] = Quality.MISFIT
    model = ColorModel.from_hex("#ffffff")
    return Solution(alpha, alpha, light, light, quality, model, "Pixelwise()", stats)


def test_a_given_color():
    assert explain(ColorModel.from_hex("#ff0000")) == [
        "One paint and its shades: all multiples of the linear RGB color (1.000, 0.000, 0.000).",
        "The color was given, not measured.",
    ]
    assert explain(ColorModel.from_hex("#ff0000", "#0000ff"))[0].startswith("Two paints")


def test_any_colors_are_called_so():
    (said,) = explain(ColorModel.any())
    assert "shape" in said


@pytest.mark.parametrize(
    ("model", "texture", "said"),
    [
        (ColorModel.any(), 0.043, "the plate's texture in it confirms alpha to 4 %."),
        (ColorModel.any(), 0.3, "the plate's texture in it confirms alpha to 30 %."),
        (ColorModel.any(), None, "No texture of the plate confirms alpha: shape and motion alone"),
        (ColorModel.from_hex("#ff0000"), None, "what is left is 0.9 times what noise leaves."),
    ],
)
def test_what_confirms_alpha_is_what_was_measured(model, texture, said):
    """Exact: nor does the sentence about the colors deny it."""
    sweep = {"path": "arc", "radius": 18.0, "radius_std": 0.03, "silhouette": "disc"}
    sweep |= {"length": 177.0, "misfit": 0.9, "texture": texture}
    told = " ".join(explain(replace(solution(sweep=sweep), model=model)))
    assert said in told
    assert ("texture" in told) == (model.rank == 3)
    assert ("alone" in told) == (model.rank == 3 and texture is None)
    assert "alone" not in " ".join(explain(ColorModel.any()))


def test_a_rival_is_a_doubt():
    """Exact; what differs by little is none."""
    assert any(
        "differs by 0.30, and the errors cover both" in x for x in doubts(solution(rival_off=0.3))
    )
    assert not any("errors cover both" in x for x in doubts(solution(rival_off=0.01)))


def test_a_highlight_that_was_told_with_it():
    """Exact."""
    sweep = {"path": "line", "radius": 18.0, "radius_std": 0.03, "silhouette": "disc"}
    sweep |= {"length": 60.0, "misfit": 0.9, "texture": None}
    assert not any("highlight" in words for words in explain(solution(sweep=sweep)))
    sweep["highlight"] = {"offset": [-3.0, 4.0], "softness": 3.0, "paint": "#68d3ff"}
    assert (
        "Of one paint, #68d3ff, with a highlight 5 px from its middle: colors are those of both."
        in explain(solution(sweep=sweep))
    )


def test_a_shadow_that_was_told_with_it():
    """Exact."""
    sweep = {"path": "line", "radius": 18.0, "radius_std": 0.03, "silhouette": "disc"}
    sweep |= {"length": 60.0, "misfit": 0.9, "texture": None}
    sweep["shadow"] = {"offset": (-6.0, 8.0), "softness": 3.0, "strength": (0.4, 0.5, 0.6)}
    solved = solution(sweep=sweep)
    assert (
        "Its shadow, 10 px from it, takes 50 % of the light behind; it is not in alpha."
        in explain(solved)
    )
    solved.quality[5:15, 5:15] = Quality.SHADOW
    assert not any("choose a region without it" in words for words in doubts(solved))
    other = replace(solved, stats={"sweep": {**sweep, "shadow": None}})
    assert any("choose a region without it" in words for words in doubts(other))


@pytest.mark.parametrize(("softness", "said"), [(0.0, False), (0.4, False), (3.62, True)])
def test_a_rim_that_is_out_of_focus(softness, said):
    """Exact: what nobody sees is not spoken of."""
    sweep = {"path": "line", "radius": 18.0, "radius_std": 0.03, "silhouette": "disc"}
    sweep |= {"length": 60.0, "misfit": 0.9, "texture": None, "softness": softness}
    words = "The lens blurs its rim by 3.6 px: it was not in focus as the plate is."
    assert (words in explain(solution(sweep=sweep))) == said


def test_what_else_the_color_may_be():
    basis = ColorModel.from_hex("#d8a03c").basis
    covariance = 0.02**2 * (np.eye(3) - basis @ basis.T)
    said = explain(ColorModel(basis, covariance, {"shape": 1.1}))[-1]
    assert said.startswith("In 95 of 100 cases no further away than #")
    assert len(explain(ColorModel(basis, covariance * 1e-9, {"shape": 1e-4}))) == 2


def test_evidence_is_told_and_nothing_is_nothing():
    given = ColorModel.from_hex("#ff0000")
    evidence = {"hue variation": 0.123, "feasibility": np.inf, "shape": 2.0}
    model = ColorModel(given.basis, np.eye(3) * 1e-4, evidence)
    assert explain(model)[1:4] == [
        "From the hues of the plate behind the streak alone: to 0.12°.",
        "From alpha between 0 and 1, and no negative light, alone: nothing.",
        "From the shape of the streak and the hues together: to 2°.",
    ]


def test_the_sum_of_alpha_is_an_area():
    said = " ".join(
        explain(solution(sum_alpha=np.pi * 100, sum_alpha_std=3.0, alpha_scale_std=0.02))
    )
    assert "Alpha up to 0.30." in said
    # hypot(3, 0.02 * 314) = 6.96
    assert "Sum of alpha 314 ± 7, if the given color is right: the area" in said
    assert "radius would be 10.0 ± 0.1." in said
    assert "not explained by the color model 10.0%" in said


def test_what_limits_the_sum_is_told():
    said = " ".join(
        explain(
            solution(
                **{"sum_alpha": 100.0, "pixels": 200, "pixels_known": 150},
                **{"streak_box": (0, 5, 25, 15), "other_boxes": ((1, 1, 2, 2),)},
            )
        )
    )
    assert "50 pixels of the streak are unknown" in said
    assert "touches the border" in said
    assert "1 other thing moved" in said


def test_an_impossible_sum_is_called_so():
    nothing = solution(sum_alpha=-50.0, sum_alpha_std=2.0)
    (doubt,) = doubts(nothing)
    assert doubt.startswith("Alpha adds up to -50, no more than nothing: what moved here does not")
    assert explain(nothing)[0] == doubt
    assert "the area" not in " ".join(explain(nothing))


def changed(**values):
    """A sound solution with other values in some of the 200 pixels of its streak."""
    sound = solution(sum_alpha=60.0, sum_alpha_std=1.0)
    maps = {name: getattr(sound, name).copy() for name in ("alpha", "alpha_std", "quality")}
    maps["alpha_std"][:] = 0.02
    for name, (rows, value) in values.items():
        maps[name][5 : 5 + rows, 5:25] = value
    return replace(sound, **maps)


def test_a_sound_solution_leaves_no_doubt():
    assert doubts(changed()) == []
    assert doubts(changed(quality=(2, Quality.MISFIT))) == []
    assert doubts(changed(alpha=(10, 1.05))) == []  # noise may do that
    outside = np.full((20, 30), Quality.OUTSIDE, np.uint8)
    assert doubts(replace(changed(), quality=outside)) == []


@pytest.mark.parametrize(
    ("flag", "says"),
    [
        (Quality.PLATE_IN_MODEL, "40% of the streak lies before a plate of the object's own"),
        (Quality.SATURATED, "40% of the streak is clipped"),
        (
            Quality.SHADOW,
            "40% of the streak is only darker than the plate: a shadow, or something black",
        ),
        (Quality.MISFIT, "40% of the streak does not fit the color"),
    ],
)
def test_a_large_flagged_part_is_a_doubt(flag, says):
    some = changed(quality=(4, flag))
    unknown = (some.quality & Quality.SATURATED) != 0
    (doubt,) = doubts(replace(some, alpha_std=np.where(unknown, np.inf, some.alpha_std)))
    assert doubt.startswith(says)


def test_clipped_pixels_that_are_known_are_no_doubt():
    assert doubts(changed(quality=(4, Quality.SATURATED))) == []


def test_what_may_all_be_a_shadow_is_the_doubt_of_all():
    (doubt,) = doubts(solution(only_light_lost=True))
    assert doubt.startswith(
        "Only light was lost: all of this may be a shadow, or an object that is"
    )


def test_what_is_in_front_is_told():
    said = " ".join(explain(changed(quality=(1, Quality.OCCLUDED))))
    assert "behind something still 10.0%" in said


def test_alpha_that_cannot_be_is_a_doubt():
    (above,) = doubts(changed(alpha=(1, 1.5)))
    assert above.startswith("Alpha goes up to 1.50, which cannot be (above 1 in 10.0% of the")
    (below,) = doubts(changed(alpha=(1, -0.5)))
    assert below.startswith("Alpha is below 0 in 10% of the streak, which cannot be: a shadow")
    assert doubts(changed(alpha=(1, -0.5), quality=(10, Quality.PLATE_IN_MODEL)))[1:] == []


def test_samples_are_only_as_good_as_the_pixels_that_were_picked():
    picked = ColorModel.from_samples(np.array([[0.8, 0.4, 0.1], [0.81, 0.4, 0.1]]))
    said = " ".join(explain(replace(solution(sum_alpha=100.0), model=picked)))
    assert "if the sampled pixels show nothing but the object: the area" in said


def test_noise_is_told_at_medium_light():
    noise = {"gain": (0, 0, 0), "read_std": (0.002,) * 3, "relative_std": (0, 0, 0)}
    said = explain(solution(image_noise=noise, plate_noise={"median_std": 0.001}))
    assert "Noise (std, white is 1): 0.002 in the image, 0.001 in the plate." in said


def test_other_things_are_refused():
    with pytest.raises(TypeError, match="got int"):
        explain(3)


def noise_fit(spread, coherence=1.0, rounding=0.0, relative=0.0, changed=0.0):
    sensor = NoiseModel(gain=2e-4, read_std=0.002, relative_std=relative)
    covariance = np.stack([np.diag((spread * row) ** 2) for row in sensor.coefficients])
    ratios = np.full((3, 4), coherence)
    return NoiseFit(sensor, NoiseModel(read_std=rounding), covariance, (), (), (), ratios, changed)


def test_noise_is_told_in_electrons():
    """Exact."""
    said = explain(noise_fit(0.01))
    assert said[0].startswith("Gain, light per electron: 0.0002000 ± 0.0000020, ")
    assert said[1] == "White is 5000 ± 50, 5000 ± 50, 5000 ± 50 electrons."
    assert said[2].startswith("Read noise, 1 is white: 0.0020000 ± 0.0000100, ")
    assert said[3:] == ["Every pixel has noise of its own."]


def test_what_else_noise_is_made_of():
    """Exact: rounding, a fraction of light, what changed, and how it hangs together."""
    said = " ".join(explain(noise_fit(0.01, 4.0, 0.006, 0.01, 0.125)))
    assert "White is" not in said
    assert "And this fraction of the light: 0.010000 ± 0.000050, " in said
    assert "Rounding to code values makes 0.43 of the variance at light 0.2" in said
    assert "Noise hangs together over 2.0, 2.0, 2.0 px (R, G, B), " in said
    assert "8x8: 4," in said
    assert "12.5% of the pixels changed by more than noise" in said


def test_gain_and_read_noise_that_are_not_told_apart():
    """Exact."""
    said = explain(noise_fit(0.9))
    assert any(line.startswith("The light is too even") for line in said)
    assert not any(line.startswith("White") for line in said)


def test_a_curve_is_told_by_the_nearest_name():
    said = explain(Transfer.from_table("x", 2 * SRGB.table(4081)))
    assert said[0] == "Nearest to srgb, which is off by up to 0.0% of full scale."
    assert said[1] == "Light 0, 0.4281 and 2 at code values 0, 1/2 and 1."


def test_a_measured_curve_tells_its_error_and_channels_that_disagree():
    fit = ResponseFit(
        SRGB,
        np.linspace(0.02, 0, 256),
        (0.1, 0.205),
        2 / 255,
        0.93,
        (0.02, 0.98),
        (0.0, 0.01, 0.05),
        True,
        np.zeros((2, 16)),
    )
    said = " ".join(explain(fit))
    assert "known to 2.0% of full scale" in said
    assert "93% of the places agree; noise 2 of 255 code values." in said
    assert "Code values 5 to 250 of 255" in said
    assert "0.1 s, 0.205 s" in said
    assert "one curve" not in said
    said = explain(replace(fit, channels_agree=False))[-1]
    assert "differs by up to 5.0%" in said
