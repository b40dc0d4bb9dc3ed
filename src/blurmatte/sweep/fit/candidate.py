"""Candidate: a fitted sweep in the light before its file, with the shadow that it casts, if any."""

from dataclasses import dataclass

from blurmatte.sweep.model.cast_shadow import CastShadow
from blurmatte.sweep.model.state import State


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted sweep."""

    state: State
    cast: CastShadow | None = None  # the shadow in which the state's plate lies
    # Pixels by which the file blurred colors, a standard deviation; 0 if it did not
    chroma_blur: float = 0.0
    opacity_std: float = 0.0  # standard deviation of the silhouette's opacity

    @property
    def parameters(self) -> int:
        """Number of parameters of path, shape and shadow."""
        return self.state.size + (CastShadow.size if self.cast is not None else 0)
