"""A solver that is written outside the package: it solves, is saved, read, explained and drawn."""

from dataclasses import dataclass

import numpy as np
import pytest

import blurmatte as bm
from blurmatte.matting import Answer, Case, PixelMaps, Solver


@dataclass(frozen=True)
class DifferenceKeyer(Solver):
    """Alpha is the change of light over the largest possible one, within the streak."""

    tolerance: float = 0.1

    def answer(self, case: Case, out: PixelMaps | None) -> Answer:
        """Key the streak."""
        width, height = case.image.size
        maps = PixelMaps.zeros(height, width) if out is None else out
        maps.quality[...] = case.flags
        inside = case.streak.mask
        change = np.linalg.norm(case.image.rgb - case.plate.rgb, axis=-1)
        maps.alpha[...] = np.where(inside, np.clip(change / change.max(), 0, 1), 0)
        maps.alpha_std[...] = np.where(inside, self.tolerance, 0)
        through = (1 - maps.alpha)[..., None]
        maps.premultiplied[...] = np.where(
            inside[..., None], case.image.rgb - through * case.plate.rgb, 0
        )
        maps.premultiplied_std[...] = maps.alpha_std[..., None] * case.plate.rgb
        return Answer(maps, case.model, case.streak, bm.matting.SolutionStats())


@pytest.fixture(scope="module")
def solution(paint):
    """The answer of the keyer for a ball of one paint."""
    noise = bm.NoiseModel(read_std=0.003)
    image, plate = (p.with_noise(noise) for p in (paint.image, paint.plate))
    return image, plate, bm.solve(image, plate, paint.model, DifferenceKeyer())


def test_its_alpha_is_the_answer_and_its_name_is_reported(solution, paint):
    _, _, found = solution
    assert found.solver == "DifferenceKeyer(tolerance=0.1)"
    assert found.stats.sum_alpha == pytest.approx(found.alpha[found.streak].sum())
    assert np.corrcoef(found.alpha.ravel(), paint.layer.alpha.ravel())[0, 1] > 0.8


def test_its_errors_are_not_calibrated_so_the_grade_is_assumed(solution):
    assert solution[2].grade is bm.Grade.ASSUMED
    assert solution[2].stats.grade_reasons[0] == "solver"


def test_its_layer_recomposes_the_image(solution):
    image, plate, found = solution
    at = found.streak
    assert np.abs(found.layer.over(plate).rgb - image.rgb)[at].max() < 0.02


def test_it_is_saved_read_explained_drawn_and_measured(solution, tmp_path):
    image, plate, found = solution
    bm.save_results(tmp_path, image, plate, found)
    back = bm.read_solution(tmp_path / "layer.exr")
    assert np.array_equal(back.alpha, found.alpha)
    assert back.solver == found.solver
    assert bm.explain(back)[0].startswith("assumed")
    assert bm.measure_motion(back).length > 50
    assert (tmp_path / "overview.png").exists()


def test_a_class_in_place_of_a_solver_is_refused(paint):
    with pytest.raises(TypeError, match="solver"):
        bm.solve(paint.image, paint.plate, paint.model, DifferenceKeyer)
