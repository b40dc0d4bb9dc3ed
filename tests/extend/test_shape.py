"""A ring, and the hypothesis that it moved: both are written outside of the package.

The answer is solved, saved, read, explained, drawn and measured.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.scenes import on_line

import blurmatte as bm
from blurmatte.errors import MotionError
from blurmatte.files.models import sweep_from_json, sweep_to_json
from blurmatte.sweep.fit.levenberg_marquardt import minimize
from blurmatte.sweep.fit.ranking import Candidate, best_of
from blurmatte.sweep.hypotheses import HYPOTHESES, Disc, Fits, Hypothesis
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.shape import FlatShape, SweptAlpha
from blurmatte.sweep.model.silhouette import DISC

SIZE, ENDS, RADIUS, HOLE = (96, 64), np.array([26.0, 30, 68, 36]), 12.0, 0.6
PAINT, STD = np.array([0.8, 0.25, 0.1]), 0.004


@dataclass(frozen=True)
class Ring(FlatShape):
    """A disc with a round hole: its radius, and that of the hole over it."""

    kind = "ring"
    name = "ring"
    names = "radius", "hole"

    def start(self, radius):
        return np.array([radius, 0.5])

    def possible(self, shape, bounds):
        return np.array([np.clip(shape[0], *bounds), np.clip(shape[1], 0.1, 0.95)])

    def opaque(self, family, path, shape, pixels):
        (radius, hole), n = shape, len(path)
        outer, inner = (
            DISC.sweep(family, path, np.array([r]), pixels) for r in (radius, radius * hole)
        )
        J, of_hole = outer.by_parameters - inner.by_parameters, inner.by_parameters[..., n]
        J[..., n] = outer.by_parameters[..., n] - hole * of_hole
        by_hole = -radius * of_hole[..., None]
        return SweptAlpha(outer.alpha - inner.alpha, np.concatenate([J, by_hole], axis=-1))

    def outline(self, shape, count):
        return DISC.outline(shape[:1], count)

    def area(self, shape):
        return float(np.pi * shape[0] ** 2 * (1 - shape[1] ** 2))


@dataclass(frozen=True)
class RingMoved(Hypothesis):
    """A ring on the path of the best disc."""

    def fits(self, fits: Fits):
        start, bounds = fits.disc.of_kind(Ring()), fits.search.bounds
        holes = (start.with_parameter("hole", hole) for hole in (0.3, 0.7))
        return [Candidate(best_of([minimize(one, bounds) for one in holes]))]


def counted_alpha(times=64, parts=5):
    """(h, w) alpha of a ring, by counting points of pixels and moments."""
    width, height = SIZE
    y, x = (np.arange(n * parts) / parts - 0.5 + 0.5 / parts for n in (height, width))
    inside = np.zeros((height * parts, width * parts))
    for t in (np.arange(times) + 0.5) / times:
        center = (1 - t) * ENDS[:2] + t * ENDS[2:]
        distance = np.hypot(x - center[0], y[:, None] - center[1])
        inside += (distance < RADIUS) & (distance > HOLE * RADIUS)
    return inside.reshape(height, parts, width, parts).mean(axis=(1, 3)) / times


@pytest.fixture(scope="module")
def pictures():
    """A ring of one paint before a colorful plate, that plate, and the true alpha."""
    rng, alpha = np.random.default_rng(4), counted_alpha()
    B = bm.rendering.colorful_plate(SIZE, 1, tile=20)
    C = alpha[..., None] * PAINT + (1 - alpha[..., None]) * B
    noise = bm.NoiseModel(read_std=STD)
    image, plate = (bm.LinearImage(x + STD * rng.standard_normal(x.shape), noise) for x in (C, B))
    return image, plate, alpha


@pytest.fixture(scope="module")
def solution(pictures):
    """The average of a disc, which leaves much to explain, and the ring."""
    return bm.solve(*pictures[:2], None, bm.Swept(hypotheses=(Disc(), RingMoved())))


def test_its_alpha_and_derivatives_are_right(pictures):
    ring, pixels, step = Ring(), Pixels(SIZE[::-1], (0, 0)), 2e-3
    shape = np.array([RADIUS, HOLE])
    swept = ring.sweep(LINE, ENDS, shape, pixels)
    assert_allclose(swept.alpha, pictures[2], atol=0.02)
    for i, d in enumerate(step * np.eye(2)):
        ends = [ring.sweep(LINE, ENDS, shape + s * d, pixels).alpha for s in (1, -1)]
        J = swept.by_parameters[..., 4 + i]
        assert_allclose((ends[0] - ends[1]) / (2 * step), J, atol=0.05 * np.abs(J).max())


def test_its_size_and_alpha_are_found(solution, pictures):
    sweep = solution.sweep
    assert sweep.silhouette == Ring()
    n, std = len(sweep.path), np.sqrt(np.diag(sweep.covariance))
    assert sweep.shape[0] == pytest.approx(RADIUS, abs=4 * std[n])
    assert sweep.shape[1] == pytest.approx(HOLE, abs=4 * std[n + 1])
    assert std[n] < 0.2
    assert np.sqrt(np.mean((solution.alpha - pictures[2])[solution.streak] ** 2)) < 0.02
    area = np.pi * RADIUS**2 * (1 - HOLE**2)
    assert np.pi * sweep.radius**2 == pytest.approx(area, rel=0.02)


def test_it_is_saved_read_explained_drawn_and_measured(solution, pictures, tmp_path):
    bm.save_results(tmp_path, *pictures[:2], solution)
    back = bm.read_solution(tmp_path / "layer.exr")
    assert back.sweep.silhouette == Ring()
    assert np.array_equal(back.sweep.shape, solution.sweep.shape)
    assert "A ring with the area of a disc of radius" in " ".join(bm.explain(back))
    motion = bm.measure_motion(back)
    assert motion.silhouette == "ring"
    assert motion.length == pytest.approx(np.hypot(42, 6), abs=4 * motion.length_std)
    assert motion.width == pytest.approx(2 * RADIUS, rel=0.03)


def test_alternatives_name_it(solution):
    assert solution.stats.alternatives[0].name.startswith("ring on ")


def test_it_cannot_be_made_sharp_and_the_message_says_why(solution, pictures):
    with pytest.raises(MotionError, match=r"only objects of one rim .* shape is: ring"):
        bm.deblurring.deblur(*pictures[:2], solution.sweep)


def test_sweep_of_a_shape_that_no_module_defines_is_not_read(solution):
    text = sweep_to_json(solution.sweep).replace('"ring"', '"torus"')
    with pytest.raises(ValueError, match="'torus' is unknown; import the module that defines it"):
        sweep_from_json(text)


def test_hypotheses_are_not_fitted_where_a_disc_leaves_nothing_to_explain():
    """Exact: this one would raise."""

    @dataclass(frozen=True)
    class NotNeeded(Hypothesis):
        def fits(self, fits: Fits):
            raise AssertionError

    ball = bm.rendering.Ball(6, PAINT)
    plate = bm.rendering.colorful_plate((64, 48), 1, tile=16)
    truth = on_line(plate, (18, 20), (44, 27), ball)
    pictures = (p.with_noise(bm.NoiseModel(read_std=STD)) for p in (truth.image, truth.plate))
    solution = bm.solve(*pictures, None, bm.Swept(hypotheses=(*HYPOTHESES, NotNeeded())))
    assert solution.sweep.silhouette.is_disc
