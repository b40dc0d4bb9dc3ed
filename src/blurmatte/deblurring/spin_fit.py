"""The spin of a ball from one blurred picture, or the reason why the picture does not determine it.

The texture of the ball is marginalized (`priors`), so that every rotation has an evidence. Its maxima
are found on a coarse lattice (`spin_search`). The likeliest are refined together with path and
shading (`refine`), and compared; the best is refined once more on a fine lattice.

Errors of the model, such as edges of paint between nodes, are not in the posterior. They show in the
gradient of log Z, to which strips of the picture contribute more than the posterior expects
(`_strip_covariance`). The log Bayes factor of the result is divided by the same inflation of variance,
and earlier ones by `VARIANCE_INFLATION`.

A ball that spins and one that shows one side explain the same pixels under the same weights. Let Z be
the evidence of the color in `priors`, Q the inverse covariance (n, n) of the color of n nodes before
the light is seen, without its constant, and C and Σ the (k, k) covariances of the k parameters of
motion and shape after and before. Then the log evidence of each is

    log Z + (3/2) log |Q| + (1/2) log (|C| / |Σ|).

Path and shape have the same prior in both. That of colored light on a ball is normalized, too.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from blurmatte.background.guess import with_noise_of_guess
from blurmatte.checks import Array
from blurmatte.deblurring.lattice import Sphere, Surface
from blurmatte.deblurring.normal_equations import FIELD_STD
from blurmatte.deblurring.priors import Differences, log_determinant
from blurmatte.deblurring.refine import ExplainedViews, explained, refined, scores
from blurmatte.deblurring.spin import HARMONICS, Spin
from blurmatte.deblurring.spin_search import (
    CONTRASTS,
    NODES_PER_RADIUS,
    SPACING,
    Search,
    are_near,
    rotation_grid,
)
from blurmatte.deblurring.view import View, check_pictures_of
from blurmatte.descent import distinct
from blurmatte.errors import SpinError
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR
from blurmatte.sweep.sweep import Sweep

VARIANCE_INFLATION = 3.0  # of the posterior of candidates, before it is measured; of rendered balls
STRIPS_PER_RADIUS = 5  # parallel to the path; the scatter of their scores gives the covariance
MIN_RADIUS_PX = 6.0  # from which on a texture is visible
MAX_MISFIT = 3.0  # reduced χ² of the residuals
SIGNIFICANT = 4.0  # standard deviations: of a rotation that is not zero, of a path that is another
MIN_COLOR_ANGLE = np.radians(5)  # from white, of a paint that is not gray
PATH_PRIOR_PX = 0.5  # a texture that turns biases the path of a sweep by more than its stated error
RADIUS_PRIOR_PX = 0.1  # the same of its radius
PRIOR = np.diag([np.pi**2] * 3 + [0.3**2] * HARMONICS)  # variances of rotation and shading
_NO_TEXTURE = 1e-3  # contrast of a ball of one paint, linear light
_COARSE_PIXELS_PER_RADIUS = 7  # of the view in which rotations are sought
_MAX_STARTS = 24  # from the grid
_RANKED_AGAIN = 150  # rotations of the grid
_NEAR = np.radians(20)  # from the likeliest rotation, of further starts
_FIRST_STEPS = 3  # of each start, before they are compared
_MAX_FINE = 3  # candidates on the fine lattice
_HOPELESS_LOG_BAYES_FACTOR = 40.0  # behind, after the first steps


def fit_spin(image: LinearImage, plate: LinearImage, sweep: Sweep) -> Spin:
    """The rotation of a ball during the exposure, from the blur of its texture.

    The ball must be a sphere seen from far away that turns at constant rate by at most about half a
    turn in the exposure. A matte surface under any distant light is part of the model. A highlight is
    part of the search alone: a spin that is not decisively likelier with one is refused.

    Parameters
    ----------
    image, plate : LinearImage
        With the ball and without.
    sweep : Sweep
        A disc on a path: `fit_sweep`, or `Solution.sweep`. Its path is refined with the spin.

    Returns
    -------
    Spin
        In the direction of time of the sweep, which one picture does not determine.

    Raises
    ------
    SpinError
        If the silhouette is no disc or too small, the texture too weak, the residuals too large, or
        two different rotations explain the picture equally well.
    TypeError, ValueError
        If an argument is something else, or sizes differ.

    Examples
    --------
    >>> spin = bm.deblurring.fit_spin(image, plate, sweep)  # doctest: +SKIP
    >>> print(f"{spin.rate_deg:.0f}° ± {spin.rate_std_deg:.0f}°")  # doctest: +SKIP
    """
    check_pictures_of(sweep, image, plate)
    _check_ball(sweep)
    image, plate = with_noise_of_guess(image, plate)
    prior = _widened(sweep)
    with threadpool_limits(1):  # most matrices are small: threads wait longer than they work
        view = View.of(image, plate, sweep, Spin(np.zeros(3), covariance=PRIOR))
        view = replace(view, sweep=prior)
        by = max(1, round(sweep.radius / _COARSE_PIXELS_PER_RADIUS))
        coarse = _candidates(view.coarser(by))
        found = coarse[0].views[0]
        fine = View.of(image, plate, found.sweep, found.spin)
        states = _refined_on_fine(fine, _likely(coarse), view.covariance)
        covariance = _strip_covariance(states[0])
    _check_path(prior, states[0].views[0].sweep)
    (view,) = states[0].views
    found = view.moved(view.parameters, covariance)
    spin = replace(_spin_of(found), sweep=found.sweep)
    _check_turning(states[0], spin)
    try:
        inflation = _inflation(view, covariance)
        margin = min(_margin(one, inflation) for one in (states, coarse[:1] + _unlikely(coarse)))
        _check_highlights(coarse)
        _check_misfit(states[0])
    except SpinError as error:
        error.likeliest = spin
        raise
    return replace(spin, log_evidence_margin=margin)


def _strip_covariance(state: ExplainedViews) -> Array:
    """(k, k) covariance of the parameters, with errors of the model that vary over the picture.

    The infinitesimal jackknife [Jaeckel 1972]: with the posterior covariance S, a strip of the picture
    along the path, whose part of the gradient of log Z is g, moves the estimate by S g. Each point of
    the ball stays near its strip, so that the parts of different strips are almost independent. An
    error of all strips alike does not show; S itself is added as a bound.
    """
    (view,) = state.views
    sweep, pixels, parts = view.sweep, view.pixels, scores(state)
    row, column = np.divmod(np.arange(len(parts)), pixels.shape[1])
    chord = sweep.trajectory.at(1.0) - sweep.trajectory.at(0.0)
    angle = np.arctan2(chord[1], chord[0])
    across = np.cos(angle) * row - np.sin(angle) * column
    strip = np.floor(STRIPS_PER_RADIUS * across / sweep.radius).astype(int)
    used = np.unique(strip[state.weights[0][:, 0] > 0])
    moves = np.stack([parts[strip == one].sum(axis=0) for one in used]) @ view.covariance
    return np.asarray(len(used) / (len(used) - 1) * moves.T @ moves + view.covariance)


def _check_ball(sweep: Sweep) -> None:
    """Raise SpinError unless the silhouette is a disc that is large enough."""
    if not sweep.silhouette.is_disc:
        raise SpinError(f"only balls have a spin, this silhouette is: {sweep.silhouette.name}")
    if sweep.radius < MIN_RADIUS_PX:
        raise SpinError(
            f"the ball's radius is {sweep.radius:.1f} px: its texture is visible from "
            f"{MIN_RADIUS_PX:g} px on"
        )


def _widened(sweep: Sweep) -> Sweep:
    """The sweep with a covariance that allows for the texture's effect on the path.

    The path of a fit that did not converge is known to a radius.
    """
    n, variances = len(sweep.path), np.zeros(len(sweep.covariance))
    variances[:n] = PATH_PRIOR_PX**2 if sweep.diagnostics.converged else sweep.radius**2
    variances[n] = RADIUS_PRIOR_PX**2
    variances[n + 1 :] = 2 * (RADIUS_PRIOR_PX / sweep.radius) ** 2  # growth: a ratio of radii
    return replace(sweep, covariance=sweep.covariance + np.diag(variances))


def _check_path(prior: Sweep, found: Sweep) -> None:
    """Raise SpinError if the refined path disagrees with the sweep."""
    away, n = found.path - prior.path, len(prior.path)
    deviation = np.sqrt(away @ np.linalg.solve(prior.covariance[:n, :n], away) / n)
    if deviation > SIGNIFICANT:
        raise SpinError(
            f"the path of the sweep is uncertain: the texture moves it by {deviation:.0f} standard "
            "deviations; solve the pictures again, with a color or a region"
        )


def _candidates(view: View) -> list[ExplainedViews]:
    """Refined rotations, compared under the same weights; the best first.

    An error of path or shading may hide a maximum from the search. It is repeated at those of the
    likeliest candidate, and further candidates begin near that one.
    """
    sphere = Sphere.of(view.sweep.radius, view.sweep.radius / NODES_PER_RADIUS)
    at, states, weights = view, list[ExplainedViews](), None
    grid = [*rotation_grid(SPACING)]
    for starts in (_MAX_STARTS, _MAX_STARTS // 2, 0):
        if starts:
            search = Search.of(at)
            ranked = search.ranked(grid)
            grid = ranked[:_RANKED_AGAIN]
            found = search.modes(ranked, _rotation(at), starts)
            wanted = _new_rotations(search, found, states)
        else:
            wanted = [_rotation(at) + sign * _NEAR * a for a in np.eye(3) for sign in (-1, 1)]
        for rotation in wanted:
            state = refined([_start(at, view.covariance, rotation)], sphere, _FIRST_STEPS)
            weights = weights or state.weights
            states.append(explained(state.views, sphere, weights))
        states = _ranked(states)
        at = states[0].views[0]
    likely = [_start(one.views[0], view.covariance) for one in _likely(states)]
    final = [explained(refined([one], sphere).views, sphere, weights) for one in likely]
    return _ranked([*final, *_unlikely(states)])


def _likely(states: Sequence[ExplainedViews]) -> list[ExplainedViews]:
    """Those with different rotations that are not far less likely than the first."""
    return distinct(
        (one for one in states if _may_be_best(states[0], one)),
        lambda one, other: are_near(_rotation(one.views[0]), _rotation(other.views[0])),
    )


def _unlikely(states: Sequence[ExplainedViews]) -> list[ExplainedViews]:
    return [state for state in states if not _may_be_best(states[0], state)]


def _may_be_best(first: ExplainedViews, state: ExplainedViews) -> bool:
    """True if the coarse lattice may have misjudged it."""
    least = VARIANCE_INFLATION * _HOPELESS_LOG_BAYES_FACTOR
    return first.fit.log_evidence - state.fit.log_evidence <= least


def _refined_on_fine(
    fine: View, candidates: Sequence[ExplainedViews], covariance: Array
) -> list[ExplainedViews]:
    """Candidates on the fine lattice, under the same weights; the likeliest first."""
    sphere, states = Sphere.finest(fine.sweep.radius), list[ExplainedViews]()
    for candidate in candidates[:_MAX_FINE]:
        (one,) = candidate.views
        start = _start(replace(fine, sweep=one.sweep, spin=one.spin), covariance)
        state = refined([start], sphere)
        states.append(explained(state.views, sphere, states[0].weights) if states else state)
    return _ranked(states)


def _start(view: View, covariance: Array, rotation: Array | None = None) -> View:
    """A view with a prior of all parameters, and perhaps another rotation."""
    rotation = _rotation(view) if rotation is None else rotation
    one = replace(view, spin=replace(_spin_of(view), rotation=rotation))
    return one.moved(one.parameters, covariance)


def _new_rotations(
    search: Search, found: Sequence[Array], states: Sequence[ExplainedViews]
) -> list[Array]:
    """Likely rotations that no state has, unless a ball without texture explains the light as well."""
    textured = max(one.log_evidence for one in search.solved(found[0], CONTRASTS))
    (plain,) = search.solved(found[0], (_NO_TEXTURE,))
    gain = (textured - plain.log_evidence) / VARIANCE_INFLATION
    if gain < DECISIVE_LOG_BAYES_FACTOR:
        raise SpinError(
            "the ball's texture is too weak for its spin: shading alone explains the light "
            f"(log Bayes factor of the texture {gain:.1f}, needed {DECISIVE_LOG_BAYES_FACTOR:g})"
        )
    known = [_rotation(state.views[0]) for state in states]
    return [w for w in found if not any(are_near(w, other) for other in known)]


def _ranked(states: list[ExplainedViews]) -> list[ExplainedViews]:
    """The likeliest first."""
    return sorted(states, key=lambda state: -state.fit.log_evidence)


def _check_highlights(states: Sequence[ExplainedViews]) -> None:
    """Raise SpinError if another rotation explains the picture with highlights, which do not turn."""
    evidences = []
    for state in states:
        (view,), (weight,) = state.views, states[0].weights
        search = Search.of(view, weight)
        evidences.append(max(search.glossy(_rotation(view), c).log_evidence for c in CONTRASTS))
    rotations = [_rotation(state.views[0]) for state in states]
    for rotation, evidence in zip(rotations, evidences, strict=True):
        margin = (evidences[0] - evidence) / VARIANCE_INFLATION
        apart = float(np.linalg.norm(rotation - rotations[0]))
        if not are_near(rotation, rotations[0]) and margin < DECISIVE_LOG_BAYES_FACTOR:
            raise SpinError(
                "a part of the pattern may be a highlight: then another spin, "
                f"{np.degrees(apart):.0f}° away, explains the picture (log Bayes factor {margin:.1f})"
            )


def _inflation(view: View, covariance: Array) -> float:
    """Mean ratio of a covariance of the rotation to that of its posterior."""
    rotation = slice(len(view.sweep.covariance), len(view.sweep.covariance) + 3)
    expected, found = (S[rotation, rotation] for S in (view.covariance, covariance))
    return float(np.trace(np.linalg.solve(expected, found)) / 3)


def _margin(states: Sequence[ExplainedViews], inflation: float) -> float:
    """Log Bayes factor of the first state over the likeliest one with a different rotation.

    Raises
    ------
    SpinError
        If it is not decisive.
    """
    best, *others = states
    rotation = _rotation(best.views[0])
    rivals = [
        (best.fit.log_evidence - other.fit.log_evidence, _rotation(other.views[0]))
        for other in others
        if not are_near(_rotation(other.views[0]), rotation)
    ]
    if not rivals:
        return float("inf")
    margin, rival = min(rivals, key=lambda one: one[0])
    margin /= inflation
    if margin < DECISIVE_LOG_BAYES_FACTOR:
        raise SpinError(
            f"two spins explain the picture: {np.degrees(np.linalg.norm(rotation)):.0f}° and "
            f"{np.degrees(np.linalg.norm(rival)):.0f}° per exposure, "
            f"{np.degrees(np.linalg.norm(rival - rotation)):.0f}° apart (log Bayes factor {margin:.1f})"
        )
    return float(margin)


def _check_misfit(state: ExplainedViews) -> None:
    """Raise SpinError if the residuals are too large."""
    if state.fit.noise_scale > MAX_MISFIT:
        raise SpinError(
            f"no spin explains the picture: the residuals are {state.fit.noise_scale:.1f} times the "
            f"noise, at most {MAX_MISFIT:g} are allowed; path or silhouette may be wrong"
        )


def _check_turning(state: ExplainedViews, spin: Spin) -> None:
    """Raise SpinError if the ball seems not to turn, and its pattern may be light instead of texture.

    Light that does not turn looks like a texture that does not turn. On one paint it adds multiples of
    the paint's color and, in a highlight, of white. Colors outside their plane are texture.
    """
    if spin.rotation @ np.linalg.solve(spin.rotation_covariance, spin.rotation) > SIGNIFICANT**2:
        return
    (view,), (blur,), (weight,) = state.views, state.blurs, state.weights
    P, white = view.light(blur.alpha), np.full(3, 3**-0.5)
    mean = np.where(weight > 0, P, 0).sum(axis=0)
    across = np.cross(mean / np.linalg.norm(mean), white)
    length = float(np.linalg.norm(across))
    if length > np.sin(MIN_COLOR_ANGLE):
        square, count = (P @ (across / length)) ** 2, 1
    else:
        square, count = (P**2).sum(axis=1) - (P @ white) ** 2, 2
    energy = float((weight[:, 0] * square).sum()) / state.fit.noise_scale
    freedom = count * int((weight > 0).sum())
    of_noise = SIGNIFICANT * np.sqrt(2 * freedom)  # fluctuation of its χ²
    if energy - freedom < max(of_noise, 2 * VARIANCE_INFLATION * DECISIVE_LOG_BAYES_FACTOR):
        raise SpinError(
            "the pattern on the ball does not turn and has the ball's color: it may be light on a ball "
            "without texture, which may spin"
        )


def _spin_of(view: View) -> Spin:
    assert view.spin is not None  # every view here has one
    return view.spin


def _rotation(view: View) -> Array:
    return _spin_of(view).rotation


def likelier_spin(
    image: LinearImage, plate: LinearImage, sweep: Sweep, flat: Sweep, lattice: Surface
) -> tuple[Spin | None, str]:
    """A spin that explains the light decisively better than a flat object, or None, and any doubt.

    `flat` is the sweep as it was refined with a flat object on the lattice, whose path is the start if
    the fit of `sweep` did not converge.
    """
    start = sweep if sweep.diagnostics.converged else replace(sweep, path=flat.path)
    try:
        spin, doubt = fit_spin(image, plate, start), ""
    except SpinError as error:
        if error.likeliest is None:
            return None, str(error)
        spin, doubt = error.likeliest, f"{error}; the likeliest spin is used"
    gain = log_bayes_factor(*with_noise_of_guess(image, plate), spin, flat, lattice)
    if gain < DECISIVE_LOG_BAYES_FACTOR:
        return None, f"a ball that spins explains the light no better (log Bayes factor {gain:.1f})"
    return spin, doubt


def log_bayes_factor(
    image: LinearImage, plate: LinearImage, spin: Spin, flat: Sweep, lattice: Surface
) -> float:
    """Of the spin over a flat object; the noise of the pictures is known."""
    still = View.of(image, plate, flat, margin=int(np.ceil(flat.radius)))
    turning = replace(still, sweep=spin.sweep or flat, spin=spin)
    sphere = Sphere.finest(turning.sweep.radius)
    weights = [turning.weight(turning.blur(sphere).alpha, around=True)]
    total = -np.linalg.slogdet(PRIOR)[1] / 2 - 3 * (sphere.unknowns - sphere.size) * np.log(
        FIELD_STD
    )
    for view, nodes, sign in ((turning, sphere, 1), (still, lattice, -1)):
        differences = Differences.of(nodes)
        band = differences.bands(differences.width)[0]
        evidence = explained([view], nodes, weights).fit.log_evidence
        evidence += 1.5 * log_determinant(band, differences)
        total += sign * (evidence + np.linalg.slogdet(view.covariance)[1] / 2)
    return float(total)
