"""Deblurred balls: exact shutters, honest errors, refinement, several pictures, doors."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.scenes import noisy, photographed, rendered

import blurmatte as bm
from blurmatte.calibration import with_noise
from blurmatte.deblurring.compressed import linearized
from blurmatte.deblurring.lattice import Lattice
from blurmatte.deblurring.sharp import affordable
from blurmatte.deblurring.view import View
from blurmatte.rendering import Camera
from blurmatte.rendering.pose import Change
from blurmatte.sweep.model.path import BOUNCE, CUBIC, FROM_REST, PARABOLA
from blurmatte.sweep.model.silhouette import Silhouette

from .conftest import NOISE, case, patches, psnr


@pytest.fixture(scope="module")
def sharp(ball):
    return bm.deblur(ball.image, ball.plate, ball.sweep)


def true_color(found, lattice):
    """Straight color at nodes well inside the ball (k, 3), and their indices."""
    reach, scene = -int(lattice.corner[0]), found.truth.scene
    at = np.arange(-reach, reach + 1.0)
    coverage, light = scene.body.sharp(at, at, scene.pose(0.5))
    inside = (coverage > 0.999) & (lattice.node >= 0)
    return light[inside], lattice.node[inside]


def test_subframes_are_closer_to_the_truth_than_the_blurred_picture(ball, sharp):
    blurred = psnr([bm.Layer(ball.sweep.alpha, ball.truth.layer.premultiplied)] * 4, ball.truth)
    assert psnr(sharp.subframes(4), ball.truth) > blurred + 8


def test_the_whole_shutter_shows_the_blurred_light(ball, sharp):
    whole = sharp.shutter(0, 1)
    assert_allclose(whole.alpha, sharp.sweeps[0].alpha, atol=2e-3)
    assert np.sqrt(np.mean((whole.premultiplied - ball.truth.layer.premultiplied) ** 2)) < 0.004


def test_shutters_average_the_moments(sharp):
    moments = [sharp.at(0.2 + 0.3 * (n + 0.5) / 64).premultiplied for n in range(64)]
    part = sharp.shutter(0.2, 0.5).premultiplied
    assert_allclose(part, np.mean(moments, axis=0), atol=5e-3)


def test_errors_are_honest():
    z = []
    for seed in range(6):
        found = case(seed=seed)
        result = bm.deblur(found.image, found.plate, found.sweep, refine=False)
        color, nodes = true_color(found, result.lattice)
        z.append((result.color[nodes] - color) / result.node_std[nodes])
    assert 0.8 < np.sqrt(np.mean(np.concatenate(z) ** 2)) < 1.25


def test_misfit_is_about_one_with_the_true_path_and_more_with_another(ball, sharp):
    assert 0.6 < sharp.misfit < 1
    wrong = replace(ball.sweep, path=ball.sweep.path + np.array([0, 0, 4.0, 1.2]))
    with pytest.warns(bm.errors.BlurmatteWarning, match="does not explain the light"):
        misfit = bm.deblur(ball.image, ball.plate, wrong, refine=False).misfit
    assert misfit > 2 * sharp.misfit


def test_refinement_moves_the_path_to_the_truth(ball):
    off = np.array([0.3, -0.2, -0.3, 0.25])
    wrong = replace(ball.sweep, path=ball.sweep.path + off, covariance=0.3**2 * np.eye(5))
    (found,) = bm.deblur(ball.image, ball.plate, wrong).sweeps
    error = found.path - ball.sweep.path
    assert np.abs(error).max() < 0.15
    assert np.sqrt(np.mean(error**2 / np.diag(found.covariance)[:4])) < 3


@pytest.mark.parametrize("change", ["length", "growth"])
def test_a_sweep_that_the_light_contradicts_is_replaced(ball, sharp, change):
    """Wrong by thirty of its standard deviations."""
    x0, y0, x1, y1 = ball.sweep.path
    longer = replace(ball.sweep, path=np.array([x0 - 5, y0 - 1.5, x1 + 5, y1 + 1.5]))
    growing = replace(
        longer,
        silhouette=Silhouette(1, changes=True),
        shape=np.array([9.5, 0.4]),
        covariance=0.05**2 * np.eye(6),
    )
    found = bm.deblur(ball.image, ball.plate, longer if change == "length" else growing)
    (sweep,) = found.sweeps
    assert np.abs(sweep.path - ball.sweep.path).max() < 0.2
    assert abs(sweep.radius - 8) < 0.1
    assert np.abs(sweep.silhouette.rates(sweep.shape)).max() < 0.02
    here, there = (psnr(one.subframes(4), ball.truth) for one in (found, sharp))
    assert here > there - 0.5


def test_a_growth_that_the_sweep_lacks_is_found():
    ball = bm.rendering.Ball(8, texture=patches(0), ambient=1.0)
    scene = replace(case().truth.scene, body=ball, change=Change(scale=(0.9, 1.1)))
    truth = rendered(scene)
    image, plate = noisy(truth, NOISE, 0)
    (sweep,) = bm.deblur(image, plate, case().sweep).sweeps
    assert sweep.silhouette.changes
    assert abs(abs(sweep.shape[1]) - np.log(1.1 / 0.9)) < 0.03


def test_a_curved_path_that_was_fitted_as_a_bounce_is_found():
    t = np.linspace(0, 1, 65)
    curved = PARABOLA.at(np.array([14.0, 28.0, 32.0, 13.0, 50.0, 28.0]), t)[0]
    truth = rendered(replace(case().truth.scene, trajectory=bm.Trajectory(curved, t)))
    image, plate = noisy(truth, NOISE, 0)
    bounce = np.array([14.5, 27.0, 32.0, 12.0, 49.5, 27.0, 0.5])
    covariance = np.diag([0.05**2] * 6 + [0.01**2, 0.05**2])
    wrong = replace(case().sweep, family=BOUNCE, path=bounce, covariance=covariance)
    (sweep,) = bm.deblur(image, plate, wrong).sweeps
    assert sweep.family == CUBIC
    assert np.abs(sweep.family.at(sweep.path, t)[0] - curved).max() < 0.3


@pytest.mark.filterwarnings("ignore::blurmatte.errors.BlurmatteWarning")
def test_parameters_that_are_fixed_keep_their_values(ball, sharp):
    """Exact: a departure at its bound, as of a line, has no information; so does another motion."""
    off = np.array([3.0, -2.0, -3.0, 2.5])
    covariance = np.diag([0.05**2] * 4 + [1e-32, 0.05**2])
    wrong = replace(
        ball.sweep,
        family=FROM_REST,
        path=np.append(ball.sweep.path + off, -0.09),
        covariance=covariance,
    )
    found = bm.deblur(ball.image, ball.plate, wrong)
    assert_allclose(found.sweeps[0].path[:4], sharp.sweeps[0].path, atol=0.1)
    assert found.sweeps[0].path[4] == pytest.approx(-0.09)


@pytest.mark.filterwarnings("ignore::blurmatte.errors.BlurmatteWarning")
def test_errors_of_a_wrong_model_are_widened():
    """The texture of a ball that spins: residuals are correlated."""
    z = []
    for seed in range(2):
        found = case(seed=seed)
        turning = replace(found.truth.scene, change=Change(spin=(0.3, 0.5, 0.2)))
        truth = rendered(turning)
        image, _ = noisy(truth, NOISE, seed)
        result = bm.deblur(image, found.plate, found.sweep, refine=False)
        color, nodes = true_color(found._replace(truth=truth), result.lattice)
        z.append((result.color[nodes] - color) / result.node_std[nodes])
    assert 0.8 < np.sqrt(np.mean(np.concatenate(z) ** 2)) < 1.25


def test_a_second_picture_in_another_direction_decreases_the_error():
    alone, together = [], []
    for seed in range(3):
        first, other = case(seed=seed), case(start=(36, 8.3), end=(24.2, 33.5), seed=seed)
        one = bm.deblur(first.image, first.plate, first.sweep)
        both = bm.deblur(
            [first.image, other.image], [first.plate, other.plate], [first.sweep, other.sweep]
        )
        color, nodes = true_color(first, one.lattice)
        alone.append(np.mean((one.color[nodes] - color) ** 2))
        together.append(np.mean((both.color[nodes] - color) ** 2))
        assert np.mean(both.node_std) < np.mean(one.node_std)
        assert both.at(0.5, picture=1).alpha.max() > 0.999
    assert np.mean(together) < 0.9 * np.mean(alone)


def test_pictures_of_different_distances_are_scaled_to_one_object(ball, sharp):
    """The second picture is from farther away: the same ball with 0.75 of the radius."""
    far = case(start=(36, 8.3), end=(24.2, 33.5), radius=6.0)
    both = bm.deblur([ball.image, far.image], [ball.plate, far.plate], [ball.sweep, far.sweep])
    assert [round(sweep.radius) for sweep in both.sweeps] == [8, 6]
    assert both.misfit < 1.3
    color, nodes = true_color(ball, sharp.lattice)
    alone, together = (np.mean((one.color[nodes] - color) ** 2) for one in (sharp, both))
    assert together < 1.1 * alone
    small = both.at(0.5, picture=1)
    assert abs(small.alpha.sum() / (np.pi * 6**2) - 1) < 0.02
    true = far.truth.scene.body.sharp(
        *(np.arange(n) - at for n, at in zip((64, 42), far.sweep.trajectory.at(0.5), strict=True)),
        far.truth.scene.pose(0.5),
    )
    inside = true[0] > 0.999
    assert np.sqrt(np.mean((small.straight() - true[1])[inside] ** 2)) < 0.1


def compressed(texture):
    """A 4:2:0 picture and its plate of a ball, and its true sweep."""
    found = case(texture=texture)
    camera = Camera(code_std=1 / 255, bits=8, jpeg_quality=90, chroma="4:2:0")
    image, plate = photographed(found.truth.scene, camera, plate_frames=5)
    assert image.meta.compression is not None
    return found, image, plate


@pytest.mark.filterwarnings("ignore::blurmatte.errors.BlurmatteWarning")  # of independent noise
def test_a_compressed_picture_is_sharper_under_the_likelihood_of_its_file():
    """A ball of saturated patches: independent noise and unblurred chroma are wrong."""
    found, image, plate = compressed(patches(5))
    fitted = bm.deblur(image, plate, case().sweep, refine=False)
    plain = replace(image, meta=replace(image.meta, compression=None))
    independent = bm.deblur(plain, plate, case().sweep, refine=False)
    color, nodes = true_color(found, fitted.lattice)
    error, before = (np.mean((one.color[nodes] - color) ** 2) for one in (fitted, independent))
    assert error < 0.8 * before


def test_errors_and_misfits_of_compressed_pictures_are_honest():
    z = []
    for seed in range(3):
        found, image, plate = compressed(patches(seed))
        result = bm.deblur(image, plate, found.sweep, refine=False)
        assert 0.6 < result.misfit < 1
        color, nodes = true_color(found, result.lattice)
        z.append((result.color[nodes] - color) / result.node_std[nodes])
    assert 0.8 < np.sqrt(np.mean(np.concatenate(z) ** 2)) < 1.25


def test_the_adjoint_of_the_coefficients_of_a_color_is_theirs():
    found, image, plate = compressed(patches(0))
    view = View.of(*with_noise(image, plate), found.sweep)
    lattice = Lattice.of(found.sweep)
    blur = view.blur(lattice)
    rng = np.random.default_rng(0)
    color, x = rng.uniform(0.2, 0.8, (lattice.size, 3)), rng.normal(size=(lattice.size, 3))
    data = linearized(view, blur, view.weight(blur.alpha), color, 1.0)
    y = [rng.normal(size=one.shape) for one in data.residuals]
    forward = sum(np.sum(a * b) for a, b in zip(data.of(x), y, strict=True))
    assert forward == pytest.approx(np.sum(x * data.adjoint(y)))


def test_color_std_covers_the_object(sharp):
    std, alpha = sharp.color_std, sharp.layer.alpha
    assert (std[alpha > 0] > 0).all()
    assert (std[alpha == 0] == 0).all()


def test_gives_the_same_numbers_again(ball, sharp):
    again = bm.deblur(ball.image, ball.plate, ball.sweep)
    assert (again.color == sharp.color).all()


def test_a_solution_is_deblurred_without_its_pictures(ball):
    alpha = ball.sweep.alpha
    light = ball.image.rgb - (1 - alpha)[..., None] * ball.plate.rgb
    std = np.full_like(light, np.sqrt(2) / 255)
    std[20, 30] = np.inf  # light that the solution leaves open
    streak = alpha > 0
    solution = bm.Solution(
        *(alpha, np.full_like(alpha, 0.01), light, std),
        *(np.where(streak, 0, 16).astype(np.uint8), ball.sweep.model, "truth"),
        sweep=ball.sweep,
    )
    assert psnr(bm.deblurring.deblur_solution(solution).subframes(4), ball.truth) > 25
    with pytest.raises(bm.errors.MotionError, match="no shape on a path"):
        bm.deblurring.deblur_solution(replace(solution, sweep=None))


def test_numbers_of_a_sweep_are_refused_as_one(ball):
    with pytest.raises(TypeError, match="sweep must be a Sweep, got str; use the `sweep` of a Sol"):
        bm.deblur(ball.image, ball.plate, ["a disc"])
    with pytest.raises(TypeError, match="sweep must be a Sweep, got Diagnostics"):
        bm.deblur(ball.image, ball.plate, ball.sweep.diagnostics)


def test_an_object_that_only_adds_light_is_refused(ball):
    """Door: it has no alpha, so that its color is not determined."""
    light = replace(ball.sweep, silhouette=ball.sweep.silhouette.with_opacity(0.0))
    with pytest.raises(bm.errors.MotionError, match="only adds light"):
        bm.deblur(ball.image, ball.plate, light)


def test_a_rejected_sweep_is_warned_of(ball):
    diagnostics = replace(ball.sweep.diagnostics, converged=False)
    rejected = replace(ball.sweep, diagnostics=diagnostics)
    with pytest.warns(bm.errors.BlurmatteWarning, match="did not converge"):
        bm.deblur(ball.image, ball.plate, rejected, refine=False)


def test_large_curved_objects_get_a_coarser_lattice(ball):
    view = View.of(*with_noise(ball.image, ball.plate), ball.sweep, None)
    coarse = affordable([view], max_work=1e4)
    assert coarse.pitch > 1.2
    assert coarse.size < Lattice.of(ball.sweep).size


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s, b: s.at(1.5), "exposure fractions"),
        (lambda s, b: s.shutter(0.6, 0.4), "exposure fractions"),
        (lambda s, b: s.subframes(0), "count must be 1"),
        (lambda s, b: s.at(0.5, picture=3), "picture must be"),
        (lambda s, b: bm.deblur([b.image], b.plate, [b.sweep] * 2), "as many sweeps"),
        (lambda s, b: bm.deblur(b.image, b.plate, replace(b.sweep, size=(9, 9))), "same size"),
    ],
)
def test_wrong_arguments_are_refused(ball, sharp, call, message):
    with pytest.raises(ValueError, match=message):
        call(sharp, ball)
