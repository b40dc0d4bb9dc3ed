"""A Sweep as JSON: exact round trips."""

import json

import numpy as np
import pytest

from blurmatte.color import ColorModel
from blurmatte.errors import FileError
from blurmatte.files.models import sweep_from_json, sweep_to_json
from blurmatte.sweep import Diagnostics, Sweep, path_family
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE, Silhouette

FAMILIES = "line", "parabola", "cubic", "arc", "bounce", "from rest"


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize(
    "silhouette",
    [
        DISC,
        ELLIPSE,
        Silhouette(4, turns=True),
        Silhouette(4, changes=True),
        Silhouette(camera_stretch=(0.1, -0.2)),
        Silhouette(opacity=0.3),
    ],
)
def test_sweep_round_trips_exactly(name, silhouette):
    """Exact."""
    rng, family = np.random.default_rng(0), path_family(name)
    n = family.size + silhouette.size
    model = ColorModel(ColorModel.from_hex("#d8ff3c").basis, 1e-4 * np.eye(3), {"shape": np.inf})
    sweep = Sweep(
        family,
        100 * rng.uniform(size=family.size),
        silhouette,
        rng.uniform(size=silhouette.size),
        model,
        np.cov(rng.normal(size=(n, 2 * n))),
        (640, 480),
        Diagnostics("leaves the streak", False, 1.1, radius_error=np.inf, chroma_blur=0.3),
        CastShadow(rng.normal(size=2), 3.3, rng.uniform(size=3)) if silhouette is DISC else None,
        0.02,
    )
    back = sweep_from_json(sweep_to_json(sweep))
    assert (back.family, back.silhouette, back.size) == (family, silhouette, (640, 480))
    for field in ("path", "shape", "covariance"):
        assert np.array_equal(getattr(back, field), getattr(sweep, field))
    assert np.array_equal(back.model.basis, model.basis)
    assert back.diagnostics == sweep.diagnostics
    assert back.opacity_std == sweep.opacity_std
    assert back.rejection == sweep.rejection
    assert (back.cast is None) == (sweep.cast is None)
    if sweep.cast is not None:
        assert np.array_equal(back.cast.offset, sweep.cast.offset)
        assert np.array_equal(back.cast.strength, sweep.cast.strength)
        assert back.cast.softness == sweep.cast.softness


def test_unknown_path_family_is_rejected():
    """Door."""
    with pytest.raises(ValueError, match="a path is one of line, arc"):
        path_family("spiral")
    with pytest.raises(ValueError, match="family is missing"):
        sweep_from_json(json.dumps({"size": [1, 2]}))


@pytest.mark.parametrize("old", [{"bulges": 0}, {"stats": {"misfit": 1.1}}])
def test_sweep_of_an_older_version_is_rejected(old):
    """Door."""
    with pytest.raises(FileError, match="solve its picture again; the sweep of an older blurmatte"):
        sweep_from_json(json.dumps({"size": [1, 2], **old}))
