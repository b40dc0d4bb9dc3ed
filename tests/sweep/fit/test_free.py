"""fit_free: silhouettes of any form, where no outline has their rim."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.scenes import noisy, rendered
from tests.sweep.scenes import GREEN, ONE_PAINT

import blurmatte as bm
from blurmatte.color.model import ColorModel
from blurmatte.files.models import sweep_from_json, sweep_to_json
from blurmatte.radiometry import NoiseModel
from blurmatte.rendering import Scene, colorful_plate
from blurmatte.rendering.coverage import cell_edges, disc_coverage, polygon_coverage
from blurmatte.streaks import require_streaks
from blurmatte.sweep.fit.free import _smoothness, fit_free
from blurmatte.sweep.fit.multistart import Multistart
from blurmatte.sweep.fit.outline import HIGHEST_ORDER
from blurmatte.sweep.hypotheses import Disc, Fits, FreeSilhouette, Outline
from blurmatte.sweep.model.mask import Mask
from blurmatte.sweep.model.silhouette import Silhouette
from blurmatte.trajectory import Trajectory

PLATE = colorful_plate((96, 72), 5, tile=20)
PATH = Trajectory.line((30.0, 30.0), (66.0, 42.0))
NOISE = NoiseModel(read_std=0.006)
OUTER, INNER = 13.0, 8.0  # radii of the ring, pixels
HAMMER = 11 * np.array(
    [(-0.2, 1.3), (-0.2, -0.6), (-0.8, -0.6), (-0.8, -1.1), (0.8, -1.1), (0.8, -0.6), (0.2, -0.6),
     (0.2, 1.3)]
)  # fmt: skip


@dataclass(frozen=True)
class Flat:
    """A body of one paint: a ring, or a hammer."""

    ring: bool

    model = ColorModel.from_samples(GREEN, std=0)

    def reach(self, pose):
        return 15.0, 15.0

    def sharp(self, x, y, pose):
        edges = cell_edges(x), cell_edges(y)
        if self.ring:
            area = disc_coverage(*edges, OUTER) - disc_coverage(*edges, INNER)
        else:
            area = np.abs(polygon_coverage(*edges, HAMMER))
        return area, area[..., None] * GREEN


RING, TOOL = (Scene(PLATE, PATH, Flat(ring)) for ring in (True, False))


@cache
def pictures(scene, seed=0):
    return noisy(rendered(scene), NOISE, seed)


@cache
def discs(scene, seed=0):
    """Discs of one paint along the streak; none is right."""
    image, plate = pictures(scene, seed)
    (streak, *_) = require_streaks(image, plate)
    search = Multistart.of(streak, image, plate, ONE_PAINT, radii=(0.8,))
    return [search.quick()]


@cache
def fitted(scene, seed=0):
    return fit_free(discs(scene, seed))


def off(state, scene):
    """Errors of alpha in the streak."""
    (x, y), (h, w) = (int(v) for v in state.observation.origin), state.swept.alpha.shape
    true = rendered(scene).layer.alpha[y : y + h, x : x + w]
    shown = (true > 0) | (state.swept.alpha > 0)
    return (state.swept.alpha - true)[shown]


@pytest.mark.parametrize(
    "scene", [RING, pytest.param(TOOL, marks=pytest.mark.battery)], ids=["ring", "hammer"]
)
def test_alpha_of_any_silhouette_is_found_from_a_disc(scene):
    state = fitted(scene)
    assert np.sqrt(np.mean(off(discs(scene)[0], scene) ** 2)) > 0.06
    assert np.sqrt(np.mean(off(state, scene) ** 2)) < 0.015
    assert state.mean_color == pytest.approx(GREEN, abs=0.04)


def test_size_and_path_of_a_ring_are_found():
    state = fitted(RING)
    mask, shape = state.silhouette, state.shape
    assert mask.area(shape) == pytest.approx(np.pi * (OUTER**2 - INNER**2), rel=0.02)
    ends = state.curve[[0, -1]] + mask.center(shape)
    ends = ends if ends[0, 0] < ends[1, 0] else ends[::-1]
    assert ends == pytest.approx(PATH.xy[[0, -1]], abs=0.6)


@pytest.mark.battery
def test_a_disc_remains_what_it_is():
    """Its few parameters cost less than cells do."""
    ball = Scene(PLATE, PATH, bm.rendering.Ball(11, GREEN, ambient=1.0))
    free, (disc,) = fitted(ball), discs(ball)
    assert free is None or free.parameters > disc.parameters + 10
    image, plate = pictures(ball)
    assert bm.solve(image, plate).sweep.silhouette.is_disc


@cache
def solution():
    image, plate = pictures(RING)
    solver = bm.Swept(hypotheses=(Disc(), FreeSilhouette()))
    return bm.solve(image, plate, None, solver)


@pytest.mark.battery
def test_it_is_the_likeliest_saved_explained_and_drawn(tmp_path):
    found = solution()
    assert isinstance(found.sweep.silhouette, Mask)
    true = rendered(RING).layer.alpha
    assert np.sqrt(np.mean((found.alpha - true)[found.streak] ** 2)) < 0.012
    back = sweep_from_json(sweep_to_json(found.sweep))
    assert back.silhouette == found.sweep.silhouette
    bm.save_results(tmp_path, *pictures(RING), found)
    assert "free silhouette" in " ".join(bm.explain(bm.read_solution(tmp_path / "layer.exr")))


@pytest.mark.battery
def test_it_can_be_made_sharp():
    sharp = bm.deblurring.deblur(*pictures(RING), solution().sweep)
    area = np.pi * (OUTER**2 - INNER**2)
    assert sharp.layer.alpha.sum() == pytest.approx(area, rel=0.05)


@pytest.mark.battery
def test_half_the_pixels_are_the_same_object():
    """Larger pixels: the same area, in pixels of the picture."""
    sweep = solution().sweep
    big = sweep.enlarged(2, (0.5, 0.5), (192, 144))
    assert big.alpha.sum() == pytest.approx(4 * sweep.alpha.sum(), rel=1e-3)


@pytest.mark.battery
@pytest.mark.parametrize(
    ("scene", "seeds", "least", "most"),
    [(RING, 4, 0.5, 2), (TOOL, 20, 0.8, 1.25)],
    ids=["ring", "hammer"],
)
def test_error_of_alpha_is_honest(scene, seeds, least, most):
    """RMSE over claim, of the likeliest, before any calibration."""
    ratios = []
    for seed in range(seeds):
        solver = bm.Swept(hypotheses=(Disc(), Outline(), FreeSilhouette()))
        found = bm.solve(*pictures(scene, seed), None, solver)
        sweep = found.sweep
        true = rendered(scene).layer.alpha
        shown = (true > 0) | (sweep.alpha > 0)
        error = np.sqrt(np.mean((sweep.alpha - true)[shown] ** 2))
        ratios.append(error / np.sqrt(np.mean(sweep.alpha_std[shown] ** 2)))
    assert least < np.median(ratios) < most


def test_smoothness_is_the_weighted_sum_of_squared_steps():
    """Oracle: the sum itself, and differences between cells of which some are left out."""
    rng = np.random.default_rng(0)
    weight, x = rng.uniform(size=(5, 4)), rng.normal(size=(5, 4))
    for free in (np.ones(x.shape, bool), rng.uniform(size=x.shape) > 0.5):
        S = _smoothness(weight)[np.flatnonzero(free)][:, np.flatnonzero(free)].toarray()
        cells = np.where(free, x, 0)
        right, down = (
            weight[:, :-1] * np.diff(cells) ** 2,
            weight[:-1] * np.diff(cells, axis=0) ** 2,
        )
        assert_allclose(x[free] @ S @ x[free], right.sum() + down.sum())


def test_it_is_fitted_where_an_outline_of_the_highest_order_explains_all():
    """And not where a disc does, or a solid object is not known."""
    state, one = discs(RING)[0], FreeSilhouette()
    image, plate = pictures(RING)
    (streak, *_) = require_streaks(image, plate)
    search = Multistart.of(streak, image, plate, ONE_PAINT, radii=(0.8,))
    fits = Fits(search, image, plate, streak, (state,), (), explained=(Disc(), state))
    assert not one.is_worth_fitting(fits)
    richest = state.of_kind(Silhouette(HIGHEST_ORDER))
    assert one.is_worth_fitting(replace(fits, explained=(Outline(), richest)))
    thin = state.of_kind(state.silhouette.with_opacity(0.5))
    assert not one.is_worth_fitting(replace(fits, one_paint=(thin,), explained=None))
