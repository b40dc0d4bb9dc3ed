"""The spin of a ball: exact without a turn, rotations against SciPy, honest estimates, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation
from tests.scenes import noisy, photographed, rendered

import blurmatte as bm
from blurmatte.deblurring import sphere_kernel, spin_fit
from blurmatte.deblurring.lattice import Lattice, Sphere
from blurmatte.deblurring.operator import poses_of
from blurmatte.deblurring.priors import fit_strength, gradient_prior
from blurmatte.deblurring.refine import explained, scores
from blurmatte.deblurring.spin import harmonics
from blurmatte.deblurring.spin_search import Search, rotation_grid
from blurmatte.deblurring.view import View
from blurmatte.rendering import Camera
from blurmatte.rendering.lighting import Lamp
from blurmatte.rendering.plates import textured_plate
from blurmatte.rendering.pose import Change
from blurmatte.sweep import Sweep
from blurmatte.sweep.model.path import LINE
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.silhouette import DISC, ELLIPSE

from .conftest import NOISE, Case, patches, psnr

SPIN = np.radians([-30.0, 55.0, 20.0])


LAMP = Lamp((0.4, -0.6, 0.7))


def spinning(spin=SPIN, seed=0, ambient=1.0, plain=False, highlight=0.0, lamps=(LAMP,)) -> Case:
    """A ball of radius 8 that moves 31 pixels, its noisy pictures, and its sweep with errors."""
    look = {"color": np.array([0.6, 0.4, 0.2])} if plain else {"texture": patches(seed)}
    ball = bm.rendering.Ball(8.0, ambient=ambient, lamps=lamps, highlight=highlight, **look)
    start, end = (18.2, 16.4), (47.7, 26.1)
    path = bm.Trajectory.line(start, end)
    scene = bm.rendering.Scene(textured_plate((66, 44), seed), path, ball, Change(spin=tuple(spin)))
    truth, rng = rendered(scene), np.random.default_rng(seed)
    pictures, error = noisy(truth, NOISE, rng), rng.normal(0, 0.1, 4)
    sweep = Sweep(
        *(LINE, np.array([*start, *end]) + error, DISC, np.array([8.0]), bm.ColorModel.any()),
        *(0.1**2 * np.eye(5), scene.size),
    )
    return Case(truth, *pictures, sweep)


@pytest.fixture(scope="module")
def ball() -> Case:
    return spinning()


@pytest.fixture(scope="module")
def spin(ball) -> bm.deblurring.Spin:
    return bm.deblurring.fit_spin(ball.image, ball.plate, ball.sweep)


@pytest.fixture(scope="module")
def search(ball) -> Search:
    return Search.of(View.of(ball.image, ball.plate, ball.sweep, bm.deblurring.Spin(np.zeros(3))))


def test_the_faces_of_a_sphere_share_the_nodes_of_their_edges():
    sphere = Sphere.of(8.0, 1.5)
    cells = sphere.node.shape[1] - 1
    assert sphere.size == 6 * cells**2 + 2
    assert len(sphere.stencils[0].nodes) == 12 * cells**2
    assert_allclose(np.linalg.norm(sphere.points, axis=1), 1)
    i, j = sphere.stencils[0].nodes.T
    assert 8 * np.linalg.norm(sphere.points[i] - sphere.points[j], axis=1).max() < 1.5


def test_without_a_turn_the_operator_is_that_of_a_flat_lattice(ball):
    """Exact for alpha, and for a color that both lattices interpolate within their pitch."""
    pixels = Pixels.of_box(ball.sweep.box)
    lattice, sphere = Lattice.of(ball.sweep), Sphere.of(8.0, 0.5)
    flat = lattice.blur(ball.sweep, pixels)
    turned = sphere.blur(
        ball.sweep, pixels, poses_of(ball.sweep, spin=bm.deblurring.Spin(np.zeros(3)))
    )
    assert_allclose(turned.alpha, flat.alpha, atol=1e-12)
    of_nodes = turned.A[:, : sphere.size]
    assert_allclose(np.asarray(of_nodes.sum(axis=1)).ravel(), flat.alpha, atol=1e-12)
    j, i = np.nonzero(lattice.node >= 0)
    x, y = (np.stack([i, j]) + lattice.corner[:, None])[:, np.argsort(lattice.node[j, i])]
    on_flat, on_sphere = 0.5 + 0.03 * x - 0.02 * y, 0.5 + 8 * sphere.points @ [0.03, -0.02, 0]
    assert_allclose(of_nodes @ on_sphere, flat.A @ on_flat, atol=5e-3)


def test_points_of_the_body_turn_as_scipy_turns_them(ball):
    """Oracle: the light of a pattern that is linear on the body, in plain loops over moments."""
    turn, pattern = bm.deblurring.Spin(SPIN), np.array([0.3, -0.5, 0.8])
    pixels, poses = Pixels.of_box(ball.sweep.box), poses_of(ball.sweep, spin=turn)
    sphere = Sphere.of(8.0, 0.5)
    A, _ = sphere.blur(ball.sweep, pixels, poses)
    row = int(np.argmax(np.asarray(A.sum(axis=1)).ravel()))
    x, y = row % pixels.shape[1] + pixels.origin[0], row // pixels.shape[1] + pixels.origin[1]
    expected, of_field = 0.0, np.zeros(8)
    for t, center in zip(poses.t, poses.xy, strict=True):
        u, v = (np.array([x, y]) - center) / 8
        if np.hypot(u, v) < 1:
            n = np.array([u, v, np.sqrt(1 - u**2 - v**2)])
            body = Rotation.from_rotvec((t - 0.5) * SPIN).inv().apply(n)
            expected += pattern @ body / len(poses.t)
            of_field += harmonics(n[None])[0] / len(poses.t)
    assert float((A[:, : sphere.size] @ (sphere.points @ pattern))[row]) == pytest.approx(
        expected, abs=0.02
    )
    assert_allclose(A[row, sphere.size :].toarray()[0], of_field, atol=0.03)


def test_jacobians_turn_the_body_as_scipy_turns_it():
    """Oracle: R(ω + δ) = exp([J δ]ₓ) R(ω) at every moment, to first order."""
    t, change = np.array([0.0, 0.3, 0.5, 1.0]), 1e-5 * np.array([0.3, -0.7, 0.5])
    small = np.einsum(
        "tij,tj->ti", bm.deblurring.Spin(SPIN + change).turns(t), np.tile([0.6, 0, 0.8], (4, 1))
    )
    turned = Rotation.from_rotvec(bm.deblurring.Spin(SPIN).jacobians(t) @ change).as_matrix()
    expected = turned @ bm.deblurring.Spin(SPIN).turns(t) @ [0.6, 0, 0.8]
    assert_allclose(small, expected, atol=1e-9)


def test_the_light_of_a_search_changes_with_the_rotation_as_its_derivatives_say(search):
    """Adjoint of the search's operator: differences over a turn of 0.001°."""
    step = np.radians(1e-3)
    (at,) = search.solved(SPIN, (0.2,))
    spin = bm.deblurring.Spin(SPIN)
    J = sphere_kernel.turned(
        *(search.entries, spin.turns(search.t), spin.jacobians(search.t)),
        *(search.sphere.node, at.texture),
    )
    for k, axis in enumerate(np.eye(3)):
        after, before = (search.operator(SPIN + s * step * axis) @ at.texture for s in (1, -1))
        error = J[..., k] - (after - before) / (2 * step)
        assert np.sqrt(np.mean(error**2)) < 0.02 * np.sqrt(np.mean(J[..., k] ** 2))


def test_scores_of_pixels_sum_to_the_gradient_of_the_evidence(ball):
    """Oracle: differences of log Z, which is evaluated at twice as many moments."""
    sweep = replace(ball.sweep, covariance=1e-3**2 * np.eye(5))
    view = View.of(
        ball.image, ball.plate, sweep, bm.deblurring.Spin(SPIN, covariance=1e-3**2 * np.eye(11))
    )
    sphere = Sphere.of(8.0, 2.5)
    state = explained([view], sphere)
    found = scores(state).sum(axis=0)
    Q = gradient_prior(sphere, state.equations.width)
    for k in (0, 5, 7, 9):  # the path, two components of the rotation, and the shading
        step = 0.01 * (np.arange(16) == k)
        after, before = (view.moved(view.parameters + s * step) for s in (1, -1))
        more, less = (
            fit_strength(
                one.equations(one.blur(sphere), sphere, state.weights[0]), Q, state.fit.strength
            )
            for one in (after, before)
        )
        slope = (more.log_evidence - less.log_evidence) / 0.02
        assert found[k] == pytest.approx(slope, rel=0.2, abs=15)


def test_secants_correct_the_curvature_along_their_steps():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 6))
    information, step = root @ root.T + np.eye(6), rng.normal(size=6)
    change = 0.3 * information @ step + 0.1 * rng.normal(size=6)
    sphere = Sphere.of(8.0, 2.0)
    corrected = sphere.with_curvature(information, [(step, change)])
    assert_allclose(corrected @ step, change)
    against = sphere.with_curvature(information, [(step, -change)])  # a gradient that grows
    assert np.linalg.eigvalsh(against).min() > 0


def test_renders_the_spinning_ball_of_the_renderer():
    """Exact: the true paint at the nodes, with the true path, gives the light of the renderer."""
    case = spinning()
    path = case.truth.trajectory.at(np.array([0.0, 1.0])).ravel()
    sweep, sphere = replace(case.sweep, path=path), Sphere.of(8.0, 0.7)
    to_start = Rotation.from_rotvec(-0.5 * SPIN)  # from the pose in the middle to the unposed ball
    bx, by, bz = to_start.apply(sphere.points).T
    texture = patches(0)
    column = ((np.arctan2(bx, bz) / (2 * np.pi) + 0.5) * texture.shape[1]).astype(int)
    rows = (np.arccos(np.clip(-by, -1, 1)) / np.pi * texture.shape[0]).astype(int)
    color = texture[np.minimum(rows, 95), np.minimum(column, 191)]
    x0, y0, x1, y1 = sweep.box
    A, _ = sphere.blur(
        sweep, Pixels.of_box(sweep.box), poses_of(sweep, spin=bm.deblurring.Spin(SPIN))
    )
    error = (A[:, : sphere.size] @ color).reshape(y1 - y0, x1 - x0, 3)
    error = error - case.truth.layer.premultiplied[y0:y1, x0:x1]
    assert np.sqrt(np.mean(error**2)) < 0.006


def test_the_light_on_a_ball_has_mean_one_over_the_disc():
    u = np.linspace(-1, 1, 401)
    x, y = (a.ravel() for a in np.meshgrid(u, u))
    inside = x**2 + y**2 < 1
    n = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=1)[inside]
    assert_allclose(harmonics(n).mean(axis=0), 0, atol=2e-3)


def test_the_grid_of_rotations_leaves_no_gap():
    grid = rotation_grid(np.radians(36))
    rng = np.random.default_rng(0)
    some = rng.normal(size=(500, 3))
    some *= np.pi * rng.uniform(0, 0.9, (500, 1)) ** (1 / 3) / np.linalg.norm(some, axis=1)[:, None]
    nearest = np.linalg.norm(some[:, None] - grid, axis=2).min(axis=1)
    assert np.degrees(nearest.max()) < 30


@pytest.mark.battery
def test_finds_the_spin_with_an_honest_error(spin):
    error = spin.rotation - SPIN
    assert np.degrees(np.linalg.norm(error)) < 5
    assert error @ np.linalg.inv(spin.rotation_covariance) @ error < 16  # 3 degrees of freedom
    assert spin.log_evidence_margin > 5
    assert "reversing path and spin" in spin.ambiguity
    assert "per exposure" in repr(spin)


@pytest.mark.battery
def test_finds_the_spin_of_a_shaded_ball():
    case = spinning(seed=2, ambient=0.35)
    found = bm.deblurring.fit_spin(case.image, case.plate, case.sweep)
    assert np.degrees(np.linalg.norm(found.rotation - SPIN)) < 8
    n = np.array([[0.4, -0.6, 0.7], [-0.6, 0.6, 0.5]])
    bright, dark = found.light(n / np.linalg.norm(n, axis=1)[:, None])
    assert bright > 1.3 * dark


def test_a_compressed_picture_of_a_spinning_ball_has_the_likelihood_of_its_file():
    case, spin = spinning(), bm.deblurring.Spin(SPIN)
    camera = Camera(code_std=1 / 255, bits=8, jpeg_quality=90, chroma="4:2:0")
    image, plate = photographed(case.truth.scene, camera, plate_frames=5)
    sharp = bm.deblur(image, plate, case.sweep, spin=spin, refine=False)
    plain = replace(image, meta=replace(image.meta, compression=None))
    independent = bm.deblur(plain, plate, case.sweep, spin=spin, refine=False)
    together, apart = (psnr(found.subframes(4), case.truth) for found in (sharp, independent))
    assert together > apart + 0.5


@pytest.mark.battery
def test_subframes_of_a_spinning_ball_are_closer_to_the_truth(ball, spin):
    sharp = bm.deblur(ball.image, ball.plate, ball.sweep, spin=spin)
    with pytest.warns(bm.errors.BlurmatteWarning, match="a ball may spin"):
        without = bm.deblur(ball.image, ball.plate, ball.sweep)
    turning, still = (psnr(found.subframes(4), ball.truth) for found in (sharp, without))
    assert turning > still + 3
    assert_allclose(sharp.spin.rotation, spin.rotation)
    assert (sharp.color_std[sharp.layer.alpha > 0] > 0).all()


def test_light_of_two_hues_does_not_turn_with_the_ball():
    """Two lamps: their hues are in the tint, and what the ball shows has its stated error."""
    lamps = (Lamp((-0.8, -0.3, 0.5), (0.9, 0.6, 0.3)), Lamp((0.8, -0.3, 0.5), (0.3, 0.5, 0.9)))
    case = spinning(ambient=0.1, lamps=lamps)
    path = case.truth.trajectory.at(np.array([0.0, 1.0])).ravel()
    prior = bm.deblurring.Spin(SPIN, covariance=np.diag([1e-4**2] * 3 + [0.3**2] * 8))
    sweep = replace(case.sweep, path=path, covariance=0.01**2 * np.eye(5))
    sharp = bm.deblur(case.image, case.plate, sweep, spin=prior)
    assert sharp.misfit < 1.2
    warm_to_cool = sharp.tint[0]  # along x
    assert warm_to_cool[0] < -0.02 < 0.02 < warm_to_cool[2]
    true = case.truth.subframes(3)[1]
    inside = (true.alpha > 0.999) & (sharp.layer.alpha > 0.999)
    z = ((sharp.layer.straight() - true.straight()) / np.maximum(sharp.color_std, 1e-9))[inside]
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.25


@pytest.mark.battery
def test_a_spin_is_chosen_by_its_evidence(ball, spin, monkeypatch):
    def chosen(answer):
        """Deblurred with this answer of the search for a spin."""

        def search(image, plate, sweep):
            """The answer."""
            if isinstance(answer, bm.deblurring.Spin):
                return answer
            raise answer

        monkeypatch.setattr(spin_fit, "fit_spin", search)
        return bm.deblur(ball.image, ball.plate, ball.sweep, spin="auto")

    assert_allclose(chosen(spin).spin.rotation, spin.rotation)
    error = bm.errors.SpinError("two spins")
    error.likeliest = spin
    with pytest.warns(bm.errors.BlurmatteWarning, match="not certain: two spins"):
        assert chosen(error).spin is not None
    refuted = pytest.warns(bm.errors.BlurmatteWarning, match="does not explain the light")
    with refuted, pytest.warns(bm.errors.BlurmatteWarning, match="not certain: too weak"):
        assert chosen(bm.errors.SpinError("too weak")).spin is None
    with pytest.raises(ValueError, match="auto"):
        bm.deblur(ball.image, ball.plate, ball.sweep, spin="maybe")


@pytest.mark.battery
def test_a_wrong_spin_has_less_evidence_than_the_right_one(ball, spin):
    flat, lattice = ball.sweep, Lattice.of(ball.sweep)
    wrong = replace(spin, rotation=-spin.rotation)
    right, other = (
        spin_fit.log_bayes_factor(ball.image, ball.plate, one, flat, lattice)
        for one in (spin, wrong)
    )
    assert right > 100
    assert right > other + 100


@pytest.mark.battery
def test_a_ball_that_does_not_turn_has_no_certain_spin():
    case = spinning(spin=np.zeros(3), seed=3)
    found = bm.deblur(case.image, case.plate, case.sweep, spin="auto").spin
    if found is not None:
        assert found.rotation @ np.linalg.inv(found.rotation_covariance) @ found.rotation < 16


@pytest.mark.battery
def test_a_plain_ball_is_refused():
    case = spinning(plain=True)
    with pytest.raises(bm.errors.SpinError, match="texture is too weak"):
        bm.deblurring.fit_spin(case.image, case.plate, case.sweep)


def test_other_shapes_and_small_balls_are_refused(ball):
    ellipse = replace(
        ball.sweep, silhouette=ELLIPSE, shape=np.array([8.0, 0.1, 0]), covariance=np.eye(7)
    )
    with pytest.raises(bm.errors.SpinError, match="ellipse"):
        bm.deblurring.fit_spin(ball.image, ball.plate, ellipse)
    with pytest.raises(bm.errors.SpinError, match="radius"):
        bm.deblurring.fit_spin(ball.image, ball.plate, replace(ball.sweep, shape=np.array([3.0])))


def test_wrong_arguments_are_refused(ball):
    still = bm.deblurring.Spin(np.zeros(3))
    with pytest.raises(TypeError, match="fit_sweep"):
        bm.deblurring.fit_spin(ball.image, ball.plate, None)
    with pytest.raises(ValueError, match="same size"):
        bm.deblurring.fit_spin(ball.image, ball.plate, replace(ball.sweep, size=(9, 9)))
    with pytest.raises(ValueError, match="rotation"):
        bm.deblurring.Spin(np.zeros(2))
    with pytest.raises(ValueError, match="one picture"):
        bm.deblur([ball.image] * 2, ball.plate, [ball.sweep] * 2, spin=still)
    with pytest.raises(TypeError, match="fit_spin"):
        bm.deblur(ball.image, ball.plate, ball.sweep, spin=SPIN)


def test_axis_and_rate():
    found = bm.deblurring.Spin(
        np.radians([0, 30.0, 0]), covariance=np.diag([1e-4, 4e-4, 1e-4, *np.zeros(8)])
    )
    assert_allclose(found.axis, [0, 1, 0])
    assert found.rate_deg == pytest.approx(30)
    assert found.rate_std_deg == pytest.approx(np.degrees(0.02))
    assert found.axis_std_deg == pytest.approx(np.degrees(np.sqrt(2e-4) / np.radians(30)))
    assert_allclose(bm.deblurring.Spin(np.zeros(3)).axis, [0, 0, 1])


@pytest.mark.battery
def test_a_highlight_on_a_plain_ball_is_no_texture():
    case = spinning(plain=True, ambient=0.35, highlight=0.6)
    with pytest.raises(bm.errors.SpinError, match=r"may be light|two spins|no spin|highlight"):
        bm.deblurring.fit_spin(case.image, case.plate, case.sweep)


@pytest.mark.battery
@pytest.mark.parametrize("seed", [0, 1])
def test_a_highlight_on_a_textured_ball_is_no_spin_of_its_own(seed):
    """Refused, or the spin of the ball: light that does not turn is part of the search."""
    case = spinning(seed=seed, ambient=0.35, highlight=0.6)
    try:
        found = bm.deblurring.fit_spin(case.image, case.plate, case.sweep)
    except bm.errors.SpinError:
        return
    error = found.rotation - SPIN
    assert error @ np.linalg.inv(found.rotation_covariance) @ error < 16


def test_texture_shading_and_highlights_solve_one_least_squares_problem(search):
    """Oracle: dense normal equations of all unknowns of three channels and the common highlights."""
    at = search.glossy(SPIN, 0.1)
    Q = np.triu(search.prior) + np.triu(search.prior, 1).T
    of_channel = np.hstack([search.operator(SPIN).toarray(), search.C])
    n, k, m = len(Q), search.C.shape[1], search.G.shape[1]
    design = np.hstack([np.kron(np.eye(3), of_channel), np.tile(search.G, (3, 1))])
    weighted = design * np.tile(search.W, 3)[:, None]
    own = block_diag(100 * Q, np.eye(k) / 0.2**2)
    prior = block_diag(own, own, own, np.eye(m) / 0.1**2)
    found = np.linalg.solve(weighted.T @ design + prior, weighted.T @ search.P.T.ravel())
    channels = found[: 3 * (n + k)].reshape(3, n + k).T
    assert_allclose(at.texture, channels[:n], atol=1e-6)
    assert_allclose(at.field, channels[n:], atol=1e-6)
    assert_allclose(at.gloss, found[3 * (n + k) :], atol=1e-6)
    energy = float((search.W[:, None] * search.P**2).sum())
    least = energy - found @ weighted.T @ search.P.T.ravel()
    assert at.noise_scale == pytest.approx(least / (3 * (len(search.P) - 1)), rel=1e-6)
