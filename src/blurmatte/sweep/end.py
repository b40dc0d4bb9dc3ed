"""End: what a search came to, in the light that it explains, and whether that is to be believed.

What files do to color is undone here, and the state of a descent becomes a `Sweep`.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.color.model import ColorModel
from blurmatte.radiometry import LinearImage, Transfer
from blurmatte.sweep import cast, highlight
from blurmatte.sweep.attenuation import attenuation, structure
from blurmatte.sweep.cast import CastShadow
from blurmatte.sweep.choice import CLEARLY, differ, most_apart, price
from blurmatte.sweep.chroma import Bled, left_untold
from blurmatte.sweep.compressed import before_compression
from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State, descend, seen, sharp
from blurmatte.sweep.freer import Freer, if_it_changes, if_not_round
from blurmatte.sweep.highlight import Highlight
from blurmatte.sweep.search import Search, is_held
from blurmatte.sweep.silhouette import BLUR_OF_FILES
from blurmatte.sweep.smooth_light import SmoothLight, smooth_light
from blurmatte.sweep.student import VARIANCE
from blurmatte.sweep.sweep import Sweep
from blurmatte.sweep.verdict import (
    HOPELESS,
    beyond_file,
    can_be,
    coherence,
    colors_ran_together,
    doubtful_share,
    is_contested,
    left_beyond_noise,
    objection,
    overstated,
)

Array = npt.NDArray[np.float64]

# Of a radius, the standard deviation of one that means anything; and where a plane or an outline takes
# up what is wrong: in compressed pictures planes known to 4 to 6 % were wrong by 10 to 20 %, and an
# ellipse known to 3.5 % by a third.
_MOST_UNSURE, _MOST_UNSURE_OF_FREE = 0.25, 0.03
_STRUCTURED = 3.0  # times its noise: the least that is texture of a plate
# Of alpha, to which the plate's texture must tell it to believe in any colors, and to believe in them
# whatever else is left, for paint is finer than a field. Of 27 right ones places were off by up to
# 0.15, of three that a few edges told, and that were off by 0.08 to 0.25, by 0.24 to 0.34.
_CONFIRMED, _EXACTLY = 0.18, 0.08
# Of alpha: balls with holes and codecs leave 0.1, wrong shapes up to 0.5. Planes and outlines, which
# take up more, are asked place by place: right ones left up to 0.17, wrong ones 0.25 on.
_MOST_ASTRAY, _MOST_OF_PLACES = 0.125, 0.2
# Of the places, where smooth light must tell a wrong alpha. Of 36 planes for which it did in more, none
# was off by 0.05; of 15 for which it did in less, ten were. One paint needs it where what is left hangs
# together: of 13 for which it told less six were off by 0.05 to 0.33; where it did not, none of six.
_LEAST_TOLD, _AS_NOISE = 0.2, 2.0
# Coherence of what a plane leaves, which takes up what one paint would leave of a wrong shape, but not
# all of it: 45 right ones that left more than noise left up to 12, 5 of 9 wrong ones 13 on.
_MOST_OF_PLANE = 12.5
# Of its radius, by which a rim is blurred: right ones had up to 0.19; of the five that had more all
# were wrong by 0.03 to 0.13.
_MOST_BLURRED = 0.25
_OF_LENSES = 1.5 * BLUR_OF_FILES  # pixels: of files that share color rims seemed to have up to 2.4
# Of the pixels, where noise was taken to be louder and has to be all that is left: 60 right ones had
# up to 0.043; of ten in which two things crossed, five of them off by more than 0.05, all had 0.08 on.
_MOST_DOUBTFUL_IN_LOUD = 0.06
# Of the pixels of an outline, or of a disc with a highlight: 250 right ones had up to 0.054, one 0.083
# and one 0.14; four wrong ones more. Of a disc whose path has a kink: 45 right ones had up to 0.056, a
# wrong one, of a sheet, 0.18. Of any disc in fine files: 80 right ones up to 0.063, two wrong more.
_MOST_DOUBTFUL = 0.1
_MOST_TURNED = 30.0  # degrees by which colors of a plane may be unsure: 90 right ones had up to 13
# Times what the file makes of noise, in two pictures: of quality 90 right ones (50) left up to 1.75,
# seven that were wrong by 0.05 to 0.33 1.85 to 11. Of quality 75, where what the plate's own file did
# is as large, right ones left up to 5: only fine files are asked.
_MOST_BEYOND_FILE, _FILES = 1.8, 2
# Of its size, by which a shape may seem to become longer or larger on its way, where that explains
# more than it costs: of 100 that did not change it did for none. It did for six drops, by 0.22 to 0.31;
# three of them had been off by 3.5 to 5 times their claims. Balls that grew by 5 to 30 %, and seemed to
# by up to 0.19, were off by 0.005 to 0.03.
_MOST_CHANGED = 0.2
_AGAIN, _NEARBY = 2, 2.0  # times, and by which factor another radius may come out then


@dataclass(frozen=True, eq=False)
class End:
    """An end of a search, in the data that it explains.

    Parameters
    ----------
    search : Search
        Of the light before colors ran together.
    state : State
    blur : float
        Pixels by which they did, 0 if not.
    cast : CastShadow, optional
        The shadow of a disc, in which the search's plate lies.
    highlight : Highlight, optional
        That of a disc, without which the search's image is.
    covariance : (size, size) float, optional
        Of the state's parameters, if it is told by how the file was compressed.
    bled : Bled, optional
        What that file made of the light, then.
    """

    search: Search
    state: State
    blur: float = 0.0
    cast: CastShadow | None = None
    highlight: Highlight | None = None
    covariance: Array | None = None
    bled: Bled | None = None

    @classmethod
    def before_bleeding(cls, search: Search, state: State, transfer: Transfer) -> "End":
        """What a state becomes of the light before a file let colors run together, if it did."""
        data, blur, contested = search.data, 0.0, state.contested
        if data.compression is not None and state.frame.rank < 3:
            bled = data.bled(transfer)
            search, state, covariance = before_compression(search, state, bled)
            state = replace(state, contested=contested)
            return cls(search, state, covariance=covariance, bled=bled)
        if ran_together(data, state):
            first = search.softest(seen(data, state))
            softness = first.silhouette.softness(first.shape)
            blur = min(softness, BLUR_OF_FILES)
            if softness > _OF_LENSES:
                return cls(search, replace(search.softest(state), contested=contested))
        for _ in range(_AGAIN if blur else 0):
            bounds = state.shape[0] / _NEARBY, state.shape[0] * _NEARBY
            alpha = sharp(data, state).swept.alpha
            before = data.before_bleeding(alpha, state.frame.within, blur, transfer)
            search = replace(search, data=before, bounds=bounds)
            state = search.softened(descend(before, sharp(before, state), bounds))
            # Luma was not blurred: a rim seems less soft than the chroma of it is.
            blur = float(np.hypot(blur, state.silhouette.softness(state.shape)))
        return cls(search, replace(state, contested=contested), blur)

    @property
    def misfit(self) -> float:
        """See `verdict.misfit`; infinite too for what only light of odd patterns would explain."""
        return np.inf if is_contested(self.state) else self.left

    @cached_property
    def left(self) -> float:
        """The same, whether it is contested or not."""
        if self.objection:
            return np.inf
        return 1.0 if self._is_told_exactly else self.beyond_noise

    @cached_property
    def beyond_noise(self) -> float:
        """What it leaves, whatever else may be said against it."""
        return left_beyond_noise(self.search.data, self.state)

    @cached_property
    def objection(self) -> str:
        """See `verdict.objection`; words too for what only light of odd patterns would explain."""
        data, state = self.search.data, self.state
        if state.frame.rank == 3 and self.rim > 0:
            return "has a blurred rim, which of any colors may be the sharp one of another shape"
        if self._is_told_exactly and state.converged and can_be(data, state):
            return ""
        said = objection(data, state)
        if said:
            return said
        if self.astray > (_MOST_OF_PLACES if self._takes_up_more else _MOST_ASTRAY):
            off = f"{self.astray:.0%}"
            return f"has an alpha that is off by {off} if its light changes little within it"
        doubtful = f"{doubtful_share(data, state):.0%} of its pixels"
        if not self._is_that_loud:
            return f"is contradicted by {doubtful}, even if the file hides most of its noise"
        if self.is_contradicted:
            return f"is contradicted by {doubtful}, too many for what is that free"
        if self._beyond_file > _MOST_BEYOND_FILE:
            return f"leaves {self._beyond_file:.1f} times what its file makes of noise"
        if self._is_too_blurred and data.known is None:
            return "has a rim so blurred that another size would leave as little"
        if self._leaves_other_colors:
            return "leaves too much that hangs together for the colors that it may have"
        if self._changes > _MOST_CHANGED:
            by = f"{self._changes:.0%}"
            return f"would explain clearly more if its shape changed by {by} while it went"
        if not self._would_be_told:
            return "is so small, or so near the plate in color, that a wrong alpha would leave no trace"
        return ""

    @property
    def rim(self) -> float:
        """Pixels by which the rim is blurred, by the lens or by the file."""
        return self.blur or self.state.silhouette.softness(self.state.shape)

    @property
    def _is_too_blurred(self) -> bool:
        """Whether the rim hides the size: of an outline, which suits much, also if it is held."""
        held = self.state.silhouette.bulges > 1 and is_held(self.state)
        return held or self.rim > _MOST_BLURRED * self.state.silhouette.radius(self.state.shape)

    @property
    def _runs_by(self) -> float:
        """Pixels by which the file let colors run, as far as that was undone."""
        compression = self.search.data.compression
        if self.covariance is None or compression is None:
            return self.blur
        return compression.spread

    @property
    def plausible(self) -> bool:
        """Whether it can be, and explains most: what says otherwise must be wrong, or this is."""
        return self.beyond_noise <= HOPELESS and not objection(self.search.data, self.state)

    @property
    def astray(self) -> float:
        """See `smooth_light`; a color that is known tells alpha of each pixel, and needs no other."""
        if self.search.data.known is not None:
            return 0.0
        return self._said.astray_of_places if self._takes_up_more else self._said.astray

    @property
    def unsure(self) -> float:
        """By how much of alpha it may be off: what light or texture says, and half of what contests it.

        One of two answers that are as likely is off by all of their difference, or not at all.
        """
        by_texture = self._off_by_texture if self.is_confirmed else 0.0
        said = self.astray if self.state.frame.rank < 3 else by_texture
        return float(np.hypot(said, self.state.contested / np.sqrt(2)))

    @property
    def _turned(self) -> Array:
        """(2, 2) covariance of turns of one paint if alpha is `unsure`: more of it takes more plate."""
        data, state = self.search.data, self.state
        if state.frame.rank != 1 or data.known is not None:
            return np.zeros((2, 2))
        weight = data.weight * state.swept.alpha**2
        behind = np.einsum("yx,yxc->c", weight, data.B) / max(float(weight.sum()), 1e-9)
        turns = self.unsure * (behind @ state.frame.across) / max(state.brightness, 1e-9)
        return np.outer(turns, turns)

    def contested_by(self, other: State) -> "End":
        """The same, contested by another end of the same light if that has another alpha."""
        most = max(self.state.contested, most_apart(self.state, [other]))
        return replace(self, state=replace(self.state, contested=most))

    def contested_as(self, other: "End") -> "End":
        """The same, contested by what contests another end that has about the same alpha."""
        if differ(other.state, seen(other.search.data, self.state)):
            return self
        most = max(self.state.contested, other.state.contested)
        return replace(self, state=replace(self.state, contested=most))

    @property
    def _parameters(self) -> int:
        of_cast = cast.PARAMETERS if self.cast is not None else 0
        of_highlight = highlight.PARAMETERS if self.highlight is not None else 0
        return self.state.size + of_cast + of_highlight

    def is_clearly_likelier_than(self, other: "End") -> bool:
        """Whether it leaves less than another, and by more than further parameters cost.

        That the other takes more parameters is no evidence for this: it must leave less even then.
        """
        gain, cost = self._gain_over(other)
        return gain > max(cost, CLEARLY)

    def is_about_as_likely_as(self, other: "End") -> bool:
        """Whether another is likelier by no more than chance may make it, with what parameters cost."""
        gain, cost = self._gain_over(other)
        return gain > cost - CLEARLY

    def _gain_over(self, other: "End") -> tuple[float, float]:
        """Log likelihood beyond that of another, and what it must gain for its parameters."""
        trust = max(overstated(end.search.data, end.state) for end in (self, other))
        cost = price(self.search.data, self._parameters - other._parameters)
        return (other.state.cost - self.state.cost) / trust, cost

    @property
    def _takes_up_more(self) -> bool:
        """Whether it has more freedom than a disc of one paint to explain what is not so."""
        return self.state.frame.rank == 2 or self.state.silhouette.bulges > 1

    @cached_property
    def _beyond_file(self) -> float:
        """See `verdict.beyond_file`; 1 if its file does not tell that."""
        data, state = self.search.data, self.state
        if self.bled is None or not data.of_fine_file:
            return 1.0
        alpha = state.swept.alpha
        variance = data.C_variance + (1 - alpha)[..., None] ** 2 * data.B_variance
        drawn = self.bled.drawn(alpha, state.frame.within, np.sqrt(variance), _FILES)
        return beyond_file(data, state, [data.with_light(light) for light in drawn])

    @property
    def _changes(self) -> float:
        """By how much its shape seems to change on its way, 0 if that explains no more than it costs.

        Of its size: the norm of the changes of the logarithms of size and stretch.
        """
        if self.state.frame.rank == 3:
            return 0.0
        change = self._if_it_changes
        pays = change.gain > price(self.search.data, len(change.freedom))
        return float(np.linalg.norm(change.freedom)) if pays else 0.0

    @cached_property
    def _if_it_changes(self) -> Freer:
        return if_it_changes(self.search.data, self.state)

    @property
    def _freer(self) -> Freer | None:
        """What a shape may be that the evidence which chose it does not exclude, or not surely."""
        if self.state.frame.rank == 3:
            return None
        if self.state.silhouette.bulges > 1 or self._changes > 0:
            return self._if_it_changes
        # A file keeps too little of a rim.
        return if_not_round(self.search.data, self.state) if self.covariance is not None else None

    @property
    def _would_be_told(self) -> bool:
        """Whether something would tell a wrong alpha: smooth light, noise, or a color that is known.

        Files take noise away and leave more of other things, and then nothing is left that told.
        """
        data, state = self.search.data, self.state
        if data.known is not None or state.frame.rank == 3:
            return True
        by_noise = state.frame.rank == 1 and coherence(data, state) <= _AS_NOISE
        return by_noise or self._said.share >= _LEAST_TOLD

    @property
    def _is_that_loud(self) -> bool:
        """Whether noise that was taken to be louder is all that is left."""
        doubtful = doubtful_share(self.search.data, self.state)
        return self.search.data.louder == 1 or doubtful <= _MOST_DOUBTFUL_IN_LOUD

    @property
    def is_contradicted(self) -> bool:
        """Whether pixels contradict what may take up more than a disc on a smooth path, or any sweep.

        Any where it is known what the file makes of noise.
        """
        data, state = self.search.data, self.state
        freer = state.silhouette.bulges > 1 or self.highlight is not None
        freer |= state.family.kink(state.path) is not None or data.of_fine_file
        free = data.known is None and freer
        return free and doubtful_share(data, state) > _MOST_DOUBTFUL

    @property
    def _leaves_other_colors(self) -> bool:
        """Whether a plane that nobody gave leaves more than files do."""
        data, state = self.search.data, self.state
        free = data.known is None and state.frame.rank == 2
        return free and coherence(data, state) > _MOST_OF_PLANE

    @property
    def is_before_texture(self) -> bool:
        """Whether the plate has texture that would be seen through."""
        return structure(self.search.data) > _STRUCTURED

    @property
    def is_confirmed(self) -> bool:
        """Whether the plate's texture would tell a wrong alpha of any colors, and does not.

        Neither where it tells most, nor in most places.
        """
        return self._off_by_texture < _CONFIRMED and self._off_in_places < _CONFIRMED

    @property
    def _is_told_exactly(self) -> bool:
        """Whether texture tells alpha so well that paint may be finer than a field of any colors."""
        return self._off_by_texture < _EXACTLY and self.is_confirmed

    @cached_property
    def _off_by_texture(self) -> float:
        """See `attenuation`; infinite for a model of fewer colors, which tells alpha itself."""
        if self.state.frame.rank < 3 or not self.is_before_texture:
            return np.inf
        return attenuation(self.search.data, self.state)

    @cached_property
    def _off_in_places(self) -> float:
        """The same where places may differ by what is believed, so that no few speak for all."""
        return attenuation(self.search.data, self.state, _CONFIRMED)

    @cached_property
    def _said(self) -> SmoothLight:
        return smooth_light(self.search.data, self.state)

    def sweep(self, image: LinearImage) -> Sweep:
        """What it tells. If it was the file that blurred the colors of its rim, the rim is sharp."""
        data, state, blur = self.search.data, self.state, self.blur
        trust = overstated(data, state)
        covariance = self._covariance(trust)
        model, k = self._model(covariance[-2:, -2:] + self._turned), len(state.path)
        most = _MOST_UNSURE_OF_FREE if self._takes_up_more else _MOST_UNSURE
        known = covariance[k, k] < (most * state.shape[0]) ** 2
        turned = model.rank == 2 and model.angle_std > _MOST_TURNED
        unknown = "size" if not known else "colors" if turned else ""
        of_lens = self.rim > _OF_LENSES or not colors_ran_together(data, state)
        of_lens |= self.covariance is not None
        soft = state.silhouette.soft and blur == 0 and of_lens
        silhouette = replace(state.silhouette, soft=soft)
        n = k + silhouette.size
        stats = {
            "converged": state.converged,
            "misfit": self.misfit if not unknown else np.inf,
            "objection": self.objection if not unknown else f"is of hardly known {unknown}",
            "coherence": trust,
            "contested": is_contested(state),
            "plausible": bool(self.plausible and known),
            "doubtful": doubtful_share(data, state),
            "astray": self.astray,
            "unsure": self.unsure,
            "texture": self._off_by_texture if self.is_confirmed else np.inf,
            "changes": self._changes,
            "rim": self.rim,
            "highlight": None if self.highlight is None else self._glossy(image),
            "louder": data.louder if self._is_that_loud else 1.0,
        }
        return Sweep(
            state.family,
            state.path,
            silhouette,
            state.shape[: silhouette.size],
            replace(model, to_srgb=image.meta.to_srgb),
            covariance[:n, :n],
            image.size,
            stats,
            self.cast,
        )

    def _covariance(self, trust: float) -> Array:
        """(size, size) of the state's parameters, with what shadow, highlight and file leave open.

        A likelihood overstates evidence by `trust`.
        """
        data, state = self.search.data, self.state
        if self.covariance is not None:
            covariance = self.covariance / trust
        else:
            H, _ = state.information(data)
            covariance = np.asarray(np.linalg.pinv(H, hermitian=True), float)
        if self.cast is not None:
            covariance += cast.covariance_added(data, state, self.cast)
        if self.highlight is not None:
            covariance += highlight.covariance_added(data, state, self.highlight)
        covariance *= trust * VARIANCE
        freer = self._freer
        if freer is not None:
            covariance += trust * VARIANCE * freer.less_known + np.outer(freer.step, freer.step)
        k = len(state.path)
        covariance[: k + 1, : k + 1] += left_untold(state.family, state.path, self._runs_by)
        return covariance

    def _glossy(self, image: LinearImage) -> dict[str, Any]:
        """Where the highlight is, and the paint that it is on as sRGB."""
        assert self.highlight is not None
        paint = ColorModel(self.state.main[:, None], np.zeros((3, 3)))
        paint = replace(paint, to_srgb=image.meta.to_srgb)
        return {**self.highlight.numbers, "paint": paint.hex[0]}

    def _model(self, turns: Array) -> ColorModel:
        """The color model, with the covariance of the one direction that stands for it."""
        if self.highlight is not None:
            return highlight.plane_of(self.search.data, self.state, self.highlight, turns)
        return _model(self.state, turns)


def ran_together(data: Data, state: State) -> bool:
    """Whether a file blurred the colors of a model."""
    return state.frame.rank < 3 and colors_ran_together(data, state)


def _model(state: State, turns: Array) -> ColorModel:
    """The same without a highlight."""
    frame = state.frame
    if frame.rank == 3:
        return ColorModel.any()
    moving = frame.across if frame.rank == 1 else frame.within
    basis = state.main[:, None] if frame.rank == 1 else frame.within
    return ColorModel(
        basis,
        moving @ turns @ moving.T,
        {"shape": float(np.degrees(np.sqrt(np.trace(turns) / 2)))},
    )
