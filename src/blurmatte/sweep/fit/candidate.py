"""Candidate: a fitted sweep in the light before its file, with the shadow that it casts, if any."""

from dataclasses import dataclass

from blurmatte.radiometry import Transfer
from blurmatte.sweep.fit.jpeg_correction import chroma_blur_std, corrected_for_file
from blurmatte.sweep.fit.residuals import colors_are_correlated
from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.state import State


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted sweep.

    Parameters
    ----------
    state : State
    cast : CastShadow, optional
        The shadow in which the state's plate lies.
    chroma_blur : float
        Pixels by which the file blurred colors, a standard deviation; 0 if it did not.
    """

    state: State
    cast: CastShadow | None = None
    chroma_blur: float = 0.0

    @property
    def parameters(self) -> int:
        """Number of parameters of path, shape and shadow."""
        return self.state.size + (CastShadow.size if self.cast is not None else 0)

    @classmethod
    def before_file(
        cls, state: State, transfer: Transfer, cast: CastShadow | None = None
    ) -> "Candidate":
        """The sweep in the light before its file, if that blurred colors."""
        known = state.observation.compression is not None
        if not known and not (state.silhouette.soft and colors_are_correlated(state)):
            return cls(state, cast)
        blur = chroma_blur_std(state)
        return cls(corrected_for_file(state, transfer), cast, blur)
