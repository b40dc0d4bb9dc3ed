"""Sweeps in words."""

from dataclasses import replace

import pytest

from blurmatte.color import ColorModel
from blurmatte.explain import doubts, explain
from blurmatte.matting import Quality


@pytest.mark.parametrize(
    ("model", "texture", "said"),
    [
        (ColorModel.any(), 0.043, "the plate's texture in it confirms alpha to 4 %."),
        (ColorModel.any(), 0.3, "the plate's texture in it confirms alpha to 30 %."),
        (ColorModel.any(), None, "No texture of the plate confirms alpha: shape and motion alone"),
        (ColorModel.from_hex("#ff0000"), None, "what is left is 0.9 times what noise leaves."),
    ],
)
def test_what_confirms_alpha_is_what_was_measured(solution, model, texture, said):
    """Exact: nor does the sentence about the colors deny it."""
    sweep = {"path": "arc", "radius": 18.0, "radius_std": 0.03, "silhouette": "disc"}
    sweep |= {"length": 177.0, "misfit": 0.9, "texture": texture}
    told = " ".join(explain(replace(solution(sweep=sweep), model=model)))
    assert said in told
    assert ("texture" in told) == (model.rank == 3)
    assert ("alone" in told) == (model.rank == 3 and texture is None)
    assert "alone" not in " ".join(explain(ColorModel.any()))


def test_a_highlight_that_was_told_with_it(solution):
    """Exact."""
    sweep = {"path": "line", "radius": 18.0, "radius_std": 0.03, "silhouette": "disc"}
    sweep |= {"length": 60.0, "misfit": 0.9, "texture": None}
    assert not any("highlight" in words for words in explain(solution(sweep=sweep)))
    sweep["highlight"] = {"offset": [-3.0, 4.0], "softness": 3.0, "paint": "#68d3ff"}
    assert (
        "Of one paint, #68d3ff, with a highlight 5 px from its middle: colors are those of both."
        in explain(solution(sweep=sweep))
    )


def test_a_shadow_that_was_told_with_it(solution):
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
def test_a_rim_that_is_out_of_focus(solution, softness, said):
    """Exact: what nobody sees is not spoken of."""
    sweep = {"path": "line", "radius": 18.0, "radius_std": 0.03, "silhouette": "disc"}
    sweep |= {"length": 60.0, "misfit": 0.9, "texture": None, "softness": softness}
    words = "The lens blurs its rim by 3.6 px: it was not in focus as the plate is."
    assert (words in explain(solution(sweep=sweep))) == said
