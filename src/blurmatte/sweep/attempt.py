"""Attempt: a disc that a search came to, and in what pictures."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry import SRGB, LinearImage, Transfer
from blurmatte.streaks import Streak
from blurmatte.sweep.cast import CastShadow
from blurmatte.sweep.descent import State
from blurmatte.sweep.end import End
from blurmatte.sweep.highlight import Highlight
from blurmatte.sweep.search import Search

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Attempt:
    """A disc, and of what it was found.

    Parameters
    ----------
    image, plate : LinearImage
        Noise known.
    streak : Streak
    search : Search
    disc : State
    cast : CastShadow, optional
        Its shadow, in which the search's plate lies.
    highlight : Highlight, optional
        On it, without which the search's image is.
    """

    image: LinearImage
    plate: LinearImage
    streak: Streak
    search: Search
    disc: State
    cast: CastShadow | None = None
    highlight: Highlight | None = None

    @property
    def transfer(self) -> Transfer:
        """Of the image's file."""
        return self.image.meta.transfer or SRGB

    @cached_property
    def end(self) -> End:
        """In the light that it explains."""
        end = End.before_bleeding(self.search, self.disc, self.transfer)
        return replace(end, cast=self.cast, highlight=self.highlight)

    def contested_by(self, other: End) -> "Attempt":
        """The same, contested by another end of the same streak if that has another alpha."""
        contested = self.end.contested_by(other.state).state.contested
        return replace(self, disc=replace(self.disc, contested=contested))

    def without(self, shadow: Bools) -> "Attempt":
        """The best disc without a part of the pictures."""
        image = replace(self.image, valid=self.image.valid & ~shadow)
        streak = replace(self.streak, mask=self.streak.mask & ~shadow)
        data = self.search.data
        search = Search.of(streak, image, self.plate, data.known, louder=data.louder)
        return Attempt(image, self.plate, streak, search, search.best(self.disc.frame.rank))
