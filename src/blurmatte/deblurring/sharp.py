"""Sharp: an object as it was at any moment of the exposure, and `deblur`, which finds it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from threadpoolctl import threadpool_limits

from blurmatte.background.guess import with_noise_of_guess
from blurmatte.checks import Array, check_kind, rows_columns
from blurmatte.deblurring.compressed import compressed_color
from blurmatte.deblurring.lattice import Lattice, Sphere, Surface
from blurmatte.deblurring.normal_equations import bandwidth
from blurmatte.deblurring.operator import Poses, poses_of
from blurmatte.deblurring.priors import Differences, fit_smooth, fit_sparse
from blurmatte.deblurring.refine import color_variance_inflation, explained, refined, refined_flat
from blurmatte.deblurring.revise import revised
from blurmatte.deblurring.spin import Spin
from blurmatte.deblurring.spin_fit import likelier_spin
from blurmatte.deblurring.view import View, check_pictures_of
from blurmatte.errors import MotionError, warn
from blurmatte.layer import Layer
from blurmatte.matting.solution import Solution
from blurmatte.notebook import Displayed
from blurmatte.radiometry import LinearImage
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.model.silhouette import OPAQUE
from blurmatte.sweep.sweep import Sweep

_MAX_WORK = 4e8  # operations of a Cholesky factor: a disc of 40 pixels on a line
MAX_MISFIT = 2.0  # of light that a motion explains: twice the variance of the noise
_COARSE_STEP_PX = 2.0  # of motion between two moments, to estimate a bandwidth


@dataclass(frozen=True, eq=False)
class Sharp(Displayed):
    """The straight color of an object, and how it moved in one or several pictures.

    Parameters
    ----------
    sweeps : tuple of Sweep
        The motion in each picture, refined.
    lattice : Lattice or Sphere
        The n points of the object where its color is known.
    color : (n, 3) float
        Straight color, linear light; with a spin under the mean light on the ball.
    node_std : (n, 3) float
        Its standard deviation.
    misfit : float
        Reduced χ² of the residuals, for files of known compression of their coefficients: about 1 or
        less if motion and noise explain the pictures, more if not. The variances of color and path
        are scaled by that of the pixels, and by the correlation of the residuals.
    spin : Spin, optional
        Of a ball that turns in space, refined.
    tint : (8, 3) float
        With a spin: coefficients of the harmonics of colored light, see `spin`; else (0, 3).

    Examples
    --------
    >>> print(sharp)
    Sharp(radius 10.0 px, 445 points, color ± 0.020, misfit 0.37)
    >>> start, end = sharp.at(0), sharp.at(1)
    >>> start.box, end.box
    ((78, 20, 99, 41), (20, 34, 41, 55))
    >>> picture = sharp.shutter(0.25, 0.75).over(plate)
    """

    sweeps: tuple[Sweep, ...]
    lattice: Surface
    color: Array
    node_std: Array
    misfit: float
    spin: Spin | None = None
    tint: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __repr__(self) -> str:
        sweep = self.sweeps[0]
        return (
            f"Sharp(radius {sweep.radius:.1f} px, {len(self.color)} points, color ± "
            f"{np.sqrt(np.mean(self.node_std**2)):.3f}, misfit {self.misfit:.2f})"
        )

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the pictures."""
        return self.sweeps[0].size

    @property
    def layer(self) -> Layer:
        """The object in the middle of the exposure of the first picture."""
        return self.at(0.5)

    @property
    def color_std(self) -> Array:
        """(H, W, 3) standard deviation of the straight color of `layer`; 0 where alpha is 0."""
        sweep = self.sweeps[0]
        values = np.concatenate([self.node_std**2, np.ones_like(self.node_std[:, :1])], axis=1)
        alpha, seen = self._seen(sweep, self._poses(sweep, 0.5, 0.5), values)
        # The light on a ball is a factor of its color, and seen once in the last column.
        variance, light = seen[..., :3], seen[..., 3:]
        variance = np.maximum(variance * light, 0) / np.maximum(alpha, 1e-12) ** 2
        if self.spin is not None:
            # The light of a lamp, max(cos, 0), has the mean 1 / 4 and the mean square 1 / 6 over a
            # sphere. Harmonics up to order 2, all that the model has, hold 99.2 % of the latter. The
            # error is the rest, in proportion to the standard deviation of the fitted light.
            truncated = np.sqrt(0.008 / 6 / (0.992 / 6 - 1 / 16))
            contrast = float(np.std(light[alpha > OPAQUE] / alpha[alpha > OPAQUE]))
            error = truncated * contrast * self.color.mean(axis=0)
            variance = np.where(alpha > 0, variance + error**2, 0)
        return self._placed(np.sqrt(variance), sweep)

    def at(self, t: float, picture: int = 0) -> Layer:
        """The sharp object at exposure fraction t, 0…1, of one of the pictures.

        Raises
        ------
        ValueError
            If t is outside 0…1, or there is no such picture.
        """
        return self.shutter(t, t, picture)

    def subframes(self, count: int, picture: int = 0) -> list[Layer]:
        """The object at the middles of `count` equal parts of the exposure.

        Raises
        ------
        ValueError
            If `count` < 1, or there is no such picture.
        """
        if count < 1:
            raise ValueError(f"count must be 1 or more, got {count}")
        return [self.at((n + 0.5) / count, picture) for n in range(count)]

    def shutter(self, start: float, end: float, picture: int = 0) -> Layer:
        """The object as a shorter exposure would show it, from one exposure fraction to another.

        Raises
        ------
        ValueError
            Unless 0 <= start <= end <= 1, or if there is no such picture.
        """
        if not 0 <= start <= end <= 1:
            raise ValueError(
                f"exposure fractions must be 0 <= start <= end <= 1, got {start}, {end}"
            )
        if not 0 <= picture < len(self.sweeps):
            raise ValueError(f"picture must be from 0 to {len(self.sweeps) - 1}, got {picture}")
        sweep = self.sweeps[picture]
        color = np.concatenate([self.color, self.tint])
        alpha, light = self._seen(sweep, self._poses(sweep, start, end), color)
        return Layer(self._placed(alpha[..., 0], sweep), self._placed(light, sweep))

    def _poses(self, sweep: Sweep, start: float, end: float) -> Poses:
        # An object that was there for a part of the exposure is opaque while it is there.
        opaque = replace(sweep, silhouette=sweep.silhouette.with_opacity(1.0))
        return poses_of(opaque, start, end, self.spin)

    def _seen(self, sweep: Sweep, poses: Poses, values: Array) -> tuple[Array, Array]:
        """Alpha (h, w, 1) in the sweep's box, and values of unknowns (n, c) times alpha (h, w, c)."""
        pixels = Pixels.of_box(sweep.box)
        A, alpha = self.lattice.blur(sweep, pixels, poses)
        sums = A[:, : len(values)] @ values
        return alpha.reshape(*pixels.shape, 1), sums.reshape(*pixels.shape, -1)

    def _placed(self, values: Array, sweep: Sweep) -> Array:
        """A box in the whole picture, zeros around it."""
        whole = np.zeros((*sweep.size[::-1], *values.shape[2:]))
        whole[rows_columns(sweep.box)] = values
        return whole


def deblur(
    image: LinearImage | Sequence[LinearImage],
    plate: LinearImage | Sequence[LinearImage],
    sweep: Sweep | Sequence[Sweep],
    *,
    refine: bool = True,
    spin: Spin | Literal["auto"] | None = None,
) -> Sharp:
    """The sharp object of one blurred picture, or of several of the same object.

    Several pictures with paths in different directions determine details that one leaves open. The
    object must show the same side in the same orientation in all, apart from the turn of its sweep.

    Parameters
    ----------
    image : LinearImage or sequence of them
        With the object.
    plate : LinearImage or sequence of them
        Without; one for all images, or one for each.
    sweep : Sweep or sequence of them
        The motion in each image: `fit_sweep`, or `Solution.sweep`.
    refine : bool
        Refine path, shape and spin by the light, and replace a sweep that it contradicts.
    spin : Spin, optional
        How a ball turns in one picture: `fit_spin`. The path is then the one that was refined with it.
        Without a spin, a ball shows one side. "auto": the spin of a disc is searched for, which takes
        10 to 35 seconds, and used if it is decisively likelier.

    Returns
    -------
    Sharp

    Raises
    ------
    TypeError, ValueError, MotionError
        If kinds, numbers or sizes differ, a spin is not of one ball, or an object only adds light.

    Warns
    -----
    BlurmatteWarning
        If a sweep has a `rejection`, the light is not explained, or a spin from a search is uncertain.

    Examples
    --------
    >>> sharp = bm.deblur(image, plate, sweep)
    >>> print(sharp)
    Sharp(radius 10.0 px, 445 points, color ± 0.020, misfit 0.37)
    >>> picture = sharp.at(0.5).over(plate)
    """
    if isinstance(spin, str) and spin != "auto":
        raise ValueError(f'spin must be a Spin, "auto" or None, got {spin!r}')
    given = None if isinstance(spin, str) else spin
    pictures = _together(image, plate, sweep, given)
    with threadpool_limits(1):  # blocks of a band are small: threads wait longer than they work
        views = [_checked_view(*one, given, refine) for one in pictures]
        found, doubt = _explained_by(views, refine and (given is None or given.sweep is None)), ""
        if spin == "auto" and len(pictures) == 1:
            found, doubt = _turned(found, *pictures[0])
    _warn_if_doubtful(found, doubt)
    return found


def _together(
    image: LinearImage | Sequence[LinearImage],
    plate: LinearImage | Sequence[LinearImage],
    sweep: Sweep | Sequence[Sweep],
    spin: Spin | None,
) -> list[tuple[LinearImage, LinearImage, Sweep]]:
    """Each image with its plate and its sweep; TypeError or ValueError if they do not fit."""
    images = list(image) if isinstance(image, Sequence) else [image]
    sweeps = list(sweep) if isinstance(sweep, Sequence) else [sweep]
    plates = list(plate) if isinstance(plate, Sequence) else [plate] * len(images)
    for one in sweeps:
        check_kind("sweep", one, Sweep, "use the `sweep` of a Solution")
    if not images or not len(images) == len(plates) == len(sweeps):
        raise ValueError(
            "give as many sweeps as images, and one plate or as many: got "
            f"{len(images)} images, {len(plates)} plates, {len(sweeps)} sweeps"
        )
    if spin is not None:
        sweeps = [_refined_with(spin, sweeps)]
    return list(zip(images, plates, sweeps, strict=True))


def _turned(
    found: Sharp, image: LinearImage, plate: LinearImage, sweep: Sweep
) -> tuple[Sharp, str]:
    """The object as a ball that spins, if that is decisively likelier, and what is not certain."""
    spin, doubt = likelier_spin(image, plate, sweep, found.sweeps[0], found.lattice)
    refuted = found.misfit > MAX_MISFIT  # then a spin that is not certain is better
    if spin is None or (doubt and not refuted):
        return found, doubt if refuted else ""
    view = _checked_view(image, plate, _refined_with(spin, [sweep]), spin, False)
    return _explained_by([view], False), doubt


def _checked_view(
    image: LinearImage, plate: LinearImage, sweep: Sweep, spin: Spin | None, refine: bool
) -> View:
    """The view of one picture; TypeError or ValueError for arguments that do not belong together.

    MotionError if the object has no alpha.
    """
    check_pictures_of(sweep, image, plate)
    if sweep.silhouette.opacity == 0:
        raise MotionError(
            "the object only adds light (opacity 0), and has no surface that could be made sharp; use "
            "its layer, or blurmatte measure for its path"
        )
    pair = with_noise_of_guess(image, plate)
    if spin is None and refine:
        sweep = revised(*pair, sweep)
    return View.of(*pair, sweep, spin)


def _refined_with(spin: Spin, sweeps: Sequence[Sweep]) -> Sweep:
    """The sweep of one ball with the path of its spin, if that was refined; ValueError for others."""
    check_kind("spin", spin, Spin, "use blurmatte.deblurring.fit_spin(image, plate, sweep)")
    check_kind("sweep", sweeps[0], Sweep, "use blurmatte.sweep.fit_sweep(image, plate)")
    if len(sweeps) > 1 or not sweeps[0].silhouette.is_disc:
        raise ValueError("a spin is that of one ball in one picture")
    return spin.sweep or sweeps[0]


def _explained_by(views: Sequence[View], refine: bool) -> Sharp:
    if views[0].spin is None:
        flat = affordable(views)
        state = refined_flat(views, flat) if refine else explained(views, flat)
    else:
        sphere = Sphere.finest(views[0].sweep.radius)
        state = (refined if refine else explained)(views, sphere)
    lattice, differences = state.lattice, Differences.of(state.lattice)
    equations = state.equations.widened(differences.width)
    smooth, strengths = fit_smooth(equations, differences, state.fit)
    inflation = color_variance_inflation(state, smooth)
    of_channels = state.of_channels().widened(differences.width)
    if any(view.stored is not None for view in views):
        color, variances, misfit = compressed_color(
            state, equations, of_channels, smooth, strengths
        )
    else:
        fit = fit_sparse([equations, of_channels], differences, smooth, strengths)
        color, misfit = fit.normal.mean, fit.noise_scale
        variances = inflation * misfit * fit.normal.variances()
    n, std = lattice.size, np.sqrt(variances)
    sweeps = tuple(
        replace(view.sweep, covariance=inflation * view.sweep.covariance) for view in state.views
    )
    return Sharp(sweeps, lattice, color[:n], std[:n], misfit, views[0].spin, color[n:])


def _warn_if_doubtful(sharp: Sharp, doubt: str) -> None:
    """Warn of sweeps that were rejected, of light that is not explained, and of a spin's doubt."""
    reasons = [
        f"the fit of the sweep {sweep.rejection}: an object deblurred along it may be wrong"
        for sweep in sharp.sweeps
        if sweep.rejection and sharp.spin is None  # a texture that turns leaves residuals
    ]
    if sharp.misfit > MAX_MISFIT:
        spin = "" if sharp.spin or doubt else ', or a ball may spin: give spin="auto" (--spin auto)'
        reasons.append(
            f"the motion does not explain the light: residuals have {sharp.misfit:.1f} times the "
            f"variance of the noise. The path may be wrong, a shadow may touch the object{spin}. "
            "Do not trust details of its color"
        )
    reasons += [f"the spin of the ball is not certain: {doubt}"] * bool(doubt)
    for reason in reasons:
        warn(reason)


def affordable(views: Sequence[View], max_work: float = _MAX_WORK) -> Lattice:
    """A lattice of one pixel, or a coarser one if a Cholesky factor would need more operations.

    A band of n nodes costs n b² operations, and both n and b are inverse to the pitch squared: large
    objects on curved paths, whose bands are wide, get a coarser lattice.
    """
    lattice = Lattice.of(views[0].sweep)
    counts = (view.moment_count(_COARSE_STEP_PX) for view in views)
    blurs = [view.blur(lattice, count) for view, count in zip(views, counts, strict=True)]
    width = max(bandwidth(blur.A, lattice) for blur in blurs)
    work = lattice.size * float(width) ** 2
    if work <= max_work:
        return lattice
    return Lattice.of(views[0].sweep, (work / max_work) ** (1 / 6))


def deblur_solution(solution: Solution) -> Sharp:
    """The sharp object of a solution that has a sweep, without its pictures.

    The premultiplied light of the solution is deblurred along its sweep, which is not refined: alpha
    was subtracted with the plate. `deblur` with the pictures is more precise.

    Raises
    ------
    MotionError
        If no sweep explains the solution, or its object only adds light.

    Examples
    --------
    >>> sharp = bm.deblurring.deblur_solution(solution)
    >>> print(sharp)
    Sharp(radius 10.0 px, 445 points, color ± 0.017, misfit 0.15)
    >>> picture = sharp.at(0.5).over(plate)
    """
    check_kind("solution", solution, Solution, "use blurmatte.solve(image, plate)")
    if solution.sweep is None:
        raise MotionError(
            "no shape on a path explains this object, so it cannot be deblurred; solve its pictures "
            "with a color or a region, until the sweep is accepted"
        )
    known = solution.known & np.isfinite(solution.premultiplied_std).all(axis=-1)
    light = np.where(known[..., None], solution.premultiplied, 0).astype(float)
    variance = np.where(known[..., None], solution.premultiplied_std, 1).astype(float) ** 2
    picture = LinearImage(light, variance, known)
    nothing = np.zeros_like(light)
    return deblur(picture, LinearImage(nothing, nothing), solution.sweep, refine=False)
