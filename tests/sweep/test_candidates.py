"""Candidates: what becomes of fits when they are compared."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose
from tests.sweep.scenes import BALL, photographed

from blurmatte.sweep import fit_sweep
from blurmatte.sweep.candidates import _source


def test_opacity_of_a_source_that_leaves_residuals_is_unknown():
    """exact: about 0 a fraction of which nothing is known has a root mean square of 1/√3."""
    light = fit_sweep(*photographed(BALL))
    explained = replace(light, diagnostics=replace(light.diagnostics, residual_excess=1.0))
    odd = replace(light, diagnostics=replace(light.diagnostics, residual_excess=17.0))
    assert _source(explained, 0.002).opacity_std == 0.002
    assert_allclose(_source(odd, 0.002).opacity_std, np.sqrt(1 / 3))
    assert _source(odd, 0.002).silhouette.opacity == 0
