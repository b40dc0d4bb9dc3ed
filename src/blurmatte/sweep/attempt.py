"""Attempt: a disc that a search came to, in what pictures, and the outline that they ask for."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry import SRGB, LinearImage, Transfer
from blurmatte.streaks import Streak
from blurmatte.sweep.cast import CastShadow
from blurmatte.sweep.choice import CLEARLY
from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State
from blurmatte.sweep.end import End
from blurmatte.sweep.highlight import Highlight
from blurmatte.sweep.outline import gained, likelier, refined
from blurmatte.sweep.search import Search
from blurmatte.sweep.verdict import MAX_MISFIT

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

    @cached_property
    def shaped(self) -> End:
        """The silhouette that the evidence asks for, if but noise is left of it; or the disc.

        Each is asked to explain the light that it tells itself: told by another it would seem worse.
        What an outline leaves it could not take up, free as it is, so that something else is wrong;
        other objections to it stay with it, and are what a refusal says. An outline that explains the
        light as it was found, and leaves but noise, contests a disc that has another alpha.

        Where a file says how it was compressed, outlines are looked for in the light that the disc
        tells: else they take up what the file did to rims. What is found in the light as it is contests
        a disc only if it is about as likely where each tells its own.
        """
        told, search = self.end, self.search
        if told.covariance is None:
            return self._outlined(search.data, self.disc)
        shaped = self._outlined(told.search.data, told.state)
        if shaped.state.silhouette.bulges > 1:
            return shaped
        found = refined(search.data, self.disc)
        if found.silhouette.bulges == 1:
            return shaped
        other = End.before_bleeding(search, found, self.transfer)
        ends = (told.search.data, told.state), (other.search.data, other.state)
        if other.beyond_noise > MAX_MISFIT or gained(*ends) < -2 * CLEARLY:
            return shaped
        return other if likelier(*ends) else shaped.contested_by(other.state)

    def _outlined(self, light: Data, disc: State) -> End:
        """The same, of the outlines that are found in some light."""
        told, best = self.end, refined(light, disc)
        if best is disc:
            return told
        if best.silhouette == disc.silhouette:
            return replace(told, state=replace(told.state, contested=best.contested))
        shaped = End.before_bleeding(self.search, best, self.transfer)
        ends = (told.search.data, told.state), (shaped.search.data, shaped.state)
        explains = shaped.beyond_noise <= MAX_MISFIT
        # Codecs hide noise, of which an outline takes up more: that its pixels say so does not speak
        # for it.
        feigned = shaped.is_contradicted and told.left <= MAX_MISFIT
        if explains and not feigned and likelier(*ends):
            return shaped
        return told.contested_by(shaped.state) if explains else told

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
