"""Correction of a fit for its file, which blurred the colors of neighbors.

`chroma_subsampling` predicts the file's effect on the light of a sweep. This effect is subtracted from
the image, and the sweep is fitted again.
"""

from dataclasses import replace

from blurmatte.radiometry import Transfer
from blurmatte.sweep.fit.candidate import Candidate
from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.residuals import colors_are_correlated
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.chroma_subsampling import light_before
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.silhouette import MAX_FILE_BLUR_PX
from blurmatte.sweep.model.state import State


def candidate_before_file(
    state: State, transfer: Transfer, cast: CastShadow | None = None
) -> Candidate:
    """The sweep in the light before its file, if that blurred colors."""
    known = state.observation.compression is not None
    if not known and not (state.silhouette.soft and colors_are_correlated(state)):
        return Candidate(state, cast)
    blur = chroma_blur_std(state)
    return Candidate(corrected_for_file(state, transfer), cast, blur)


def corrected_for_file(state: State, transfer: Transfer) -> State:
    """A sweep that was fitted to the light of a file, fitted to its light before the file."""
    observed, blur = state.observation, chroma_blur_std(state)
    bounds = state.shape[0] / 2, state.shape[0] * 2
    for _ in range(2):  # the second correction starts from the shape of the first
        before = light_before_file(observed, state, transfer, blur)
        state = minimize(state.relit(before), bounds, max_steps=15, tolerance=ROUGH_TOLERANCE)
    return state


def chroma_blur_std(state: State) -> float:
    """Standard deviation by which the file blurred chroma, pixels.

    That of the file's compression if known, else the blur of the fitted rim.
    """
    compression = state.observation.compression
    if compression is not None:
        return compression.spread
    return min(state.silhouette.softness(state.shape), MAX_FILE_BLUR_PX)


def light_before_file(
    observed: Observation, state: State, transfer: Transfer, blur: float
) -> Observation:
    """An observation corrected for the file's effect on the light that a state predicts."""
    alpha = state.swept.alpha
    own = state.field.light(alpha) @ state.observation.color.axes.T
    file = observed.file(transfer, blur)
    light = light_before(observed.C, observed.B, alpha, own, file, transfer)
    return replace(observed.with_light(light), color=state.observation.color)
