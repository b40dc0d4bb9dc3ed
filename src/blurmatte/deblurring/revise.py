"""Sweeps that the light contradicts: other motions of the same object, found in coarse pictures.

A fit of a sweep may stop at a wrong maximum, with a wrong length or a growth that compensates it, and
a small covariance. The evidence of the light of any color, see `refine`, shows this, if the pixels
around the streak are data as well. In pictures of blocks of pixels its maxima are wide.

With the gradient g of log Z and the information H under a wide prior, the evidence can increase by
about gᵀ H⁻¹ g / 2. If that is decisive, a disc of constant size is refined from the sweep, then one
that grows; if the path moves far, from other lengths and from the sweep as it was fitted, too. Motions
compare by their Laplace approximation

    log Z(θ) + log (det C / det Σ) / 2,

with the prior Σ, which is flat between them, and the posterior covariance C. If none explains the
light, only the path is refined.

The fit may have found another kind of path, such as a bounce for an arc, for alpha hardly differs. If a
cubic path can increase the evidence decisively more than one of the fitted kind, both are searched for.
"""

from dataclasses import dataclass, replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.deblurring.lattice import Lattice
from blurmatte.deblurring.refine import ExplainedViews, explained, information_of, refined
from blurmatte.deblurring.view import View
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import DECISIVE_LOG_BAYES_FACTOR, scaled_inverse
from blurmatte.sweep.model.path import CUBIC
from blurmatte.sweep.model.silhouette import as_silhouette
from blurmatte.sweep.sweep import Diagnostics, Sweep

Names = tuple[str, ...]  # of parameters of a shape

# Settings of the search for other motions.
_RADII = (3.0, 6.0)  # of the object in coarse pictures, blocks
_MAX_STEPS = 20  # of a refinement from another motion
_LEAST_GAIN = 2.0  # of the log evidence by a step: the path is refined again
_SCALES = (1.0, 0.7, 1.4)  # of paths to start from
_FAR = 0.1  # change of the path, of the radius, from which other starts are tried
_HELD_STD_PX = 1e-3  # of parameters that are held
# Share of the information of coarse pictures that the prior of the last refinement keeps. Their
# light determines the motion again, so this is the share that counts twice.
_KEPT_INFORMATION = 0.01


@dataclass(frozen=True, eq=False)
class _BlockPicture:
    """A picture of blocks of pixels, the lattice and the weights of all motions in it."""

    view: View
    lattice: Lattice
    weights: list[Array]

    @classmethod
    def of(cls, view: View, by: int) -> "_BlockPicture":
        """Of blocks of `by` x `by` pixels."""
        coarse, lattice = view.coarser(by), Lattice.of(view.sweep, by)
        alpha = coarse.blur(lattice).alpha
        return cls(coarse, lattice, [coarse.weight(alpha, around=True)])

    def start(self, sweep: Sweep) -> ExplainedViews:
        """The light explained by a sweep."""
        return explained([replace(self.view, sweep=sweep)], self.lattice, self.weights)

    def refined(self, sweep: Sweep) -> ExplainedViews:
        """The light explained by the likeliest sweep from this one."""
        view = replace(self.view, sweep=sweep)
        return refined([view], self.lattice, _MAX_STEPS, self.weights, _LEAST_GAIN)


@dataclass(frozen=True, eq=False)
class _RefinedSweep:
    """A refined sweep with its posterior covariance, its log evidence, and its reduced χ²."""

    sweep: Sweep
    log_evidence: float
    misfit: float

    @classmethod
    def of(cls, state: ExplainedViews, prior: Array) -> "_RefinedSweep":
        """Of explained light, by the prior covariance of the parameters."""
        sweep, free = state.views[0].sweep, np.diag(prior) > 0
        volumes = [np.linalg.slogdet(C[np.ix_(free, free)])[1] for C in (sweep.covariance, prior)]
        evidence = state.fit.log_evidence + float(volumes[0] - volumes[1]) / 2
        return cls(sweep, evidence, state.fit.noise_scale)


@dataclass(frozen=True, eq=False)
class _Start:
    """A sweep to search from, the parameters that are held, its log evidence, and an expected one.

    The latter is that of a maximum if the log evidence is quadratic.
    """

    sweep: Sweep
    held: Names
    log_evidence: float
    expected: float

    @classmethod
    def of(cls, level: _BlockPicture, sweep: Sweep) -> "_Start":
        held = _held(level.view, sweep)
        state = level.start(_wide(sweep, held, grows=True))
        information, gradient = information_of(state, state)
        gain = float(gradient @ scaled_inverse(information) @ gradient) / 2
        return cls(sweep, held, state.fit.log_evidence, state.fit.log_evidence + gain)


def revised(image: LinearImage, plate: LinearImage, sweep: Sweep) -> Sweep:
    """The sweep, or another one that the light prefers decisively; the noise of pictures is known."""
    view = View.of(image, plate, sweep, margin=int(np.ceil(sweep.radius))).for_path()
    coarse, fine = (
        _BlockPicture.of(view, max(1, round(sweep.radius / radius))) for radius in _RADII
    )
    known = _Start.of(fine, sweep)
    least = known.log_evidence + DECISIVE_LOG_BAYES_FACTOR
    starts = [known] if known.expected >= least else []
    if sweep.family != CUBIC:
        smooth = _Start.of(fine, _on_cubic(sweep))
        if smooth.expected >= max(least, known.expected + DECISIVE_LOG_BAYES_FACTOR):
            starts.append(smooth)
    found = [(*_searched(coarse, fine, start), start.sweep) for start in starts]
    found = [one for one in found if one[0].log_evidence >= least]
    if not found:
        return sweep
    best, held, before = max(found, key=lambda one: one[0].log_evidence)
    wider = np.full(len(best.sweep.covariance), _KEPT_INFORMATION**-0.5)
    ratio = _variances(before, held) / _variances(best.sweep, held)
    wider[_positions(best.sweep, held)] = np.sqrt(ratio)
    return replace(
        best.sweep,
        covariance=best.sweep.covariance * wider * wider[:, None],
        diagnostics=Diagnostics(chroma_blur=sweep.diagnostics.chroma_blur),
    )


def _searched(
    coarse: _BlockPicture, fine: _BlockPicture, start: _Start
) -> tuple[_RefinedSweep, Names]:
    """The likeliest motion on a path of the start's family, and the parameters that were held."""
    sweep, held = start.sweep, start.held
    steady = _wide(sweep, held, grows=False)
    found = _grown([fine], [steady], held)
    if any(_is_far(one.sweep, sweep) for one in found):
        found = _grown([coarse, fine], _scaled(steady), held)
        if sweep.silhouette.has("rates"):
            found.append(_refined([coarse, fine], [_wide(sweep, held, grows=True)]))
    best = max(found, key=lambda one: one.log_evidence)
    if best.misfit > 1:  # a shape of another size may hide what is wrong: a spin, or a shadow
        held = sweep.silhouette.names
        starts = _scaled(_wide(sweep, held, sweep.silhouette.has("rates")))
        best = _refined([coarse, fine], starts)
    return best, held


def _on_cubic(sweep: Sweep) -> Sweep:
    """The sweep on the nearest cubic path, whose points are known to a radius."""
    (path,), n, m = CUBIC.starts(sweep.family.curve(sweep.path)), len(sweep.path), CUBIC.size
    covariance = np.zeros((m + len(sweep.shape), m + len(sweep.shape)))
    covariance[:m, :m] = sweep.radius**2 * np.eye(m)
    covariance[m:, m:] = sweep.covariance[n:, n:]
    return replace(sweep, family=CUBIC, path=path, covariance=covariance)


def _grown(levels: list[_BlockPicture], starts: list[Sweep], held: Names) -> list[_RefinedSweep]:
    """The likeliest motion from some starts, and for a disc one that grows."""
    found = [_refined(levels, starts)]
    if starts[0].silhouette.is_disc:
        found.append(_refined(levels[-1:], [_wide(found[0].sweep, held, grows=True)]))
    return found


def _refined(levels: list[_BlockPicture], starts: list[Sweep]) -> _RefinedSweep:
    """The likeliest motion from sweeps whose covariance is the prior, through finer pictures."""
    prior = starts[0].covariance
    for level in levels:
        state = max(map(level.refined, starts), key=lambda one: one.fit.log_evidence)
        starts = [replace(state.views[0].sweep, covariance=prior)]
    return _RefinedSweep.of(state, prior)


def _is_far(sweep: Sweep, other: Sweep) -> bool:
    """True if the paths differ by a part of the radius, or the radii do."""
    ends = np.array([0.0, 1.0])
    apart = np.abs(sweep.family.at(sweep.path, ends)[0] - other.family.at(other.path, ends)[0])
    return bool(max(apart.max(), abs(sweep.radius - other.radius)) > _FAR * other.radius)


def _scaled(sweep: Sweep) -> list[Sweep]:
    """The sweep, and others whose paths are shorter and longer."""
    points = 2 * (len(sweep.path) // 2)
    xy = sweep.path[:points].reshape(-1, 2)
    middle, found = xy.mean(axis=0), []
    for scale in _SCALES:
        path = sweep.path.copy()
        path[:points] = (middle + scale * (xy - middle)).ravel()
        found.append(replace(sweep, path=path))
    return found


def _held(view: View, sweep: Sweep) -> Names:
    """The parameters of the shape that the fit knows better than light of any color in coarse pictures.

    The blur of the rim; and the radius, if the fit knows the colors or the file blurs them: at the rim
    light of any color may be that of the plate.
    """
    return ("blur",) if sweep.model.rank == 3 and view.stored is None else ("radius", "blur")


def _positions(sweep: Sweep, names: Names) -> list[int]:
    """Where the parameters of these names are that the shape has, among all of the sweep."""
    n, known = len(sweep.path), sweep.silhouette.names
    return [n + k for k, name in enumerate(known) if name in names]


def _variances(sweep: Sweep, names: Names) -> Array:
    """Variances of the parameters of the shape that have these names."""
    return np.diag(sweep.covariance)[_positions(sweep, names)]


def _wide(sweep: Sweep, held: Names, grows: bool) -> Sweep:
    """The sweep with a wide prior: its path is known to a radius. Discs grow or do not.

    Objects move in any direction, with a focal length of at least the picture's size: the growth of one
    that moves by a part of the picture is of that order.
    """
    n, silhouette = len(sweep.path), sweep.silhouette
    points = 2 * (n // 2)  # pixels; a departure is a fraction of the exposure
    wider = np.full(len(sweep.covariance), sweep.radius)
    wider /= np.sqrt(max(np.diag(sweep.covariance)[:points].max(), 1e-9))
    wider[_positions(sweep, held)] = _HELD_STD_PX / np.sqrt(_variances(sweep, held))
    covariance = sweep.covariance * wider * wider[:, None]
    if not silhouette.is_disc or silhouette.has("rates") == grows:
        return replace(sweep, covariance=covariance)
    other = replace(as_silhouette(silhouette), changes=grows)
    if grows:
        covariance = np.insert(np.insert(covariance, n + 1, 0, axis=0), n + 1, 0, axis=1)
        covariance[n + 1, n + 1] = (sweep.length / max(sweep.size)) ** 2
    else:
        covariance = np.delete(np.delete(covariance, n + 1, axis=0), n + 1, axis=1)
    shape = other.like(silhouette, sweep.shape)
    return replace(sweep, silhouette=other, shape=shape, covariance=covariance)
