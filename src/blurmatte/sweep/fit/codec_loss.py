"""Correction of a fit for its file: light that a clip's codec removed, colors that a JPEG blurred.

The blocks of a moving object are new in each frame, and their small coefficients are coded as zero: a
rim that motion made faint is lost, and the disc seems smaller. In this file L is the light that the
quantizer removes of the change C − B that a fit predicts if blocks are predicted from the plate.
Encoders may do better, so that the image before the codec is C + φ L with 0 ≤ φ ≤ 1. φ is fitted along
with path, shape and colors; to first order these move by φ d,

    d = −H⁻¹ (g(1) − g(0)),

with the curvature H and the gradients g of the cost before and after. The part of the loss that path
and shape imitate does not determine φ: there its mean is the fitted φ, and its variance the prior one.

`chroma_subsampling` predicts a JPEG file's effect on the light of a sweep. This effect is subtracted
from the image, and the sweep is fitted again, until it hardly changes.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from blurmatte.checks import Array
from blurmatte.radiometry import SRGB, LinearImage, Transfer
from blurmatte.radiometry.compression import FrameCoding
from blurmatte.statistics import UNIFORM_VARIANCE, cell_means
from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.ranking import Candidate, colors_are_correlated
from blurmatte.sweep.model.chroma_subsampling import light_after, light_before
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.silhouette import MAX_FILE_BLUR_PX
from blurmatte.sweep.model.state import State
from blurmatte.sweep.model.student_t import VARIANCE
from blurmatte.sweep.sweep import Sweep

# Fits of a sweep to light corrected for its file: the first prediction has the rim that the file
# blurred, and each fit removes about half of that blur
_MAX_CORRECTIONS = 8


def before_loss(sweep: Sweep, state: State, image: LinearImage) -> Sweep:
    """The sweep of a state of an image before its codec; the same if its quantizers are not known."""
    observation, coding, transfer = state.observation, image.meta.coding, image.meta.transfer
    lost = None if coding is None else _lost_light(state, coding, transfer or SRGB)
    if lost is None:
        return sweep
    after = state.relit(observation.with_light(observation.C + lost))
    H, g = after.information()
    g_before = state.information()[1]
    d = -np.linalg.pinv(H, hermitian=True) @ (g - g_before)
    inflation = state.variance_inflation * VARIANCE
    before, then = (_slope(one, lost) for one in (state, after))
    known = max(float(then - before + (g - g_before) @ d), 0.0) / inflation
    score = (before + g_before @ d) / inflation
    mean, variance = 1 / 2, UNIFORM_VARIANCE  # of φ before the fit: uniform from 0 to 1
    fraction = np.clip((mean / variance - score) / (1 / variance + known), 0, 1)
    step = fraction * d
    n, r = len(sweep.path), sweep.silhouette.value("radius", sweep.shape)
    shape = sweep.silhouette.possible(sweep.shape + step[n:], (r / 2, 2 * r))
    covariance = sweep.covariance + variance * np.outer(d, d)
    return replace(sweep, path=sweep.path + step[:n], shape=shape, covariance=covariance)


def _slope(state: State, lost: Array) -> float:
    """Of the cost by φ; colors are those of the least cost."""
    observation, alpha = state.observation, state.swept.alpha[..., None]
    _, _, V_C, V_B = observation.light
    along = lost @ observation.color.axes / np.sqrt(V_C + (1 - alpha) ** 2 * V_B)
    return float(np.einsum("yx,cyx,yxc->", state.weights, state.e, along))


def _lost_light(state: State, coding: FrameCoding, transfer: Transfer) -> Array | None:
    """L, (h, w, 3); None if it is not known."""
    observation, alpha, side = state.observation, state.swept.alpha, int(state.observation.scale)
    light = np.maximum((1 - alpha)[..., None] * observation.B + state.own_light, 0)
    codes, plate = (np.asarray(transfer.encode(x)) for x in (light, observation.B))
    x, y = (int(at - (side - 1) / 2) for at in observation.origin)
    lost = coding.cropped(x, y).lost(np.kron(codes - plate, np.ones((side, side, 1))))
    if lost is None:
        return None
    return np.asarray(light - transfer.decode(np.maximum(codes - cell_means(lost, side), 0)))


def candidate_before_file(candidate: Candidate, transfer: Transfer) -> Candidate:
    """The candidate in the light before its file, if that blurred colors; with a pattern as it is."""
    state, blur = candidate.state, 0.0
    if candidate.covariance is not None:
        return candidate
    known = state.observation.compression is not None
    if known or (state.silhouette.has("blur") and colors_are_correlated(state)):
        blur = chroma_blur_std(state)
        state = corrected_for_file(state, transfer)
    return replace(candidate, state=state, chroma_blur=blur)


def corrected_for_file(state: State, transfer: Transfer) -> State:
    """A sweep that was fitted to the light of a file, fitted to its light before the file."""
    bounds = state.radius / 2, state.radius * 2
    corrected = correction(state.observation, transfer, chroma_blur_std(state))
    for _ in range(_MAX_CORRECTIONS):
        start = state.relit(corrected(state))
        state = minimize(start, bounds, max_steps=15, tolerance=ROUGH_TOLERANCE)
        if start.cost - state.cost < ROUGH_TOLERANCE:
            break
    return state


def chroma_blur_std(state: State) -> float:
    """Standard deviation by which the file blurred chroma, pixels.

    That of the file's compression if known, else the blur of the fitted rim.
    """
    compression = state.observation.compression
    if compression is not None:
        return compression.spread
    return min(state.silhouette.softness(state.shape), MAX_FILE_BLUR_PX)


def correction(
    observed: Observation, transfer: Transfer, blur: float
) -> Callable[[State], Observation]:
    """A function of a state: the observation without the effect of its file on the predicted light.

    blur: by which a file blurs chroma whose compression is not known, pixels.
    """
    C, B, file = observed.rgb(observed.C), observed.rgb(observed.B), observed.file(transfer, blur)
    plates = B, light_after(B, file.seen, transfer)

    def corrected(state: State) -> Observation:
        """The observation along the axes of color of the state."""
        light = light_before(C, plates, state.swept.alpha, state.own_light, file, transfer)
        return replace(observed.with_light(light), color=state.observation.color)

    return corrected
