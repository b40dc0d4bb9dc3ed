"""Pictures of one still scene with different exposures, and places that can be compared in them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools, Floats, check_same_size
from blurmatte.errors import ResponseError
from blurmatte.radiometry.image import LinearImage

Array = npt.NDArray[np.float64]

_LOOKED_AT = 1_000_000  # pixels, evenly spread, from which places are chosen
_PER_LEVEL = 15  # places of each of 256 brightnesses and each channel
_ENOUGH = 100  # places that two pictures must share
_APART = 3.0  # standard deviations by which exposure times must differ
_BRIGHTER = 1 / 255  # code values by which a longer exposure must be brighter
_AROUND = [(y, x) for y in (0, 1, 2) for x in (0, 1, 2) if (y, x) != (1, 1)]


@dataclass(frozen=True, eq=False)
class Bracket:
    """Pictures by rising exposure time.

    Parameters
    ----------
    pictures : tuple of LinearImage
    names : tuple of str
    times : (N,) float
        Seconds.
    time_std : float
        Relative standard deviation of the times.
    """

    pictures: tuple[LinearImage, ...]
    names: tuple[str, ...]
    times: Array
    time_std: float

    @classmethod
    def of(
        cls,
        pictures: Sequence[LinearImage],
        exposure_times: Sequence[float] | None,
        time_std: float,
    ) -> "Bracket":
        """Checked and sorted."""
        pictures = tuple(pictures)
        if len(pictures) < 2:
            raise ValueError(f"pictures must be two or more, got {len(pictures)}")
        names = tuple(p.meta.source or f"picture {i}" for i, p in enumerate(pictures, 1))
        for name, picture in zip(names, pictures, strict=True):
            check_same_size(names[0], pictures[0].size, name, picture.size)
            _check_codes(name, picture)
        times = _times(pictures, names, exposure_times)
        if np.log(times.max() / times.min()) <= max(_APART * time_std, 1e-6):
            raise ValueError(
                f"the exposure times are all about {times[0]:.4g} s; take pictures whose times "
                "differ by factors of two or more"
            )
        order = np.argsort(times, kind="stable")
        sorted_pictures = tuple(pictures[i] for i in order)
        sorted_names = tuple(names[i] for i in order)
        return cls(sorted_pictures, sorted_names, times[order], time_std)

    @property
    def ratios(self) -> Array:
        """(N,) times over their geometric mean."""
        return np.asarray(self.times / np.exp(np.mean(np.log(self.times))))

    @property
    def rounding(self) -> float:
        """Standard deviation of rounding to code values, a fraction of full scale."""
        return float(max(1 / ((p.meta.levels or 65536) - 1) for p in self.pictures) / 12**0.5)

    def places(self) -> "list[Places]":
        """Of each channel, or of one if the pictures are gray."""
        gray = all(p.meta.gray for p in self.pictures)
        step = max(1, round((self.pictures[0].valid.size / _LOOKED_AT) ** 0.5))
        own, means = [], []
        contrast: npt.NDArray[np.float64] = np.zeros(1)
        for picture in self.pictures:
            rgb = picture.rgb[..., :1] if gray else picture.rgb
            height, width = picture.valid.shape
            neighbors = np.stack(
                [rgb[y : height - 2 + y : step, x : width - 2 + x : step] for y, x in _AROUND]
            )
            own.append(rgb[1 : height - 1 : step, 1 : width - 1 : step])
            means.append(neighbors.mean(axis=0))
            contrast = contrast + neighbors.mean(axis=-1)
        shape = -1, own[0].shape[-1], len(own)
        codes = np.stack(own, axis=-1).reshape(shape)
        around = np.stack(means, axis=-1).reshape(shape)
        detail = np.ptp(contrast, axis=0).ravel()
        return [Places.chosen(codes[:, c], around[:, c], detail) for c in range(shape[1])]


@dataclass(frozen=True, eq=False)
class Places:
    """Pixels of one channel or several, as all pictures show them.

    Parameters
    ----------
    codes : (N, pictures) float
        Code values, 0…1.
    around : (N, pictures) float
        Mean of the eight neighbors. Whatever is chosen by it does not depend on the noise of `codes`,
        so that choosing does not bend the curve.
    """

    codes: Array
    around: Array

    @classmethod
    def chosen(cls, codes: Floats, around: Floats, detail: Array) -> "Places":
        """As many places of each brightness, those with the least detail first."""
        level = np.rint(around.mean(axis=1) * 255).astype(int)
        inside = np.count_nonzero((around > 0) & (around < 1), axis=1) >= 2
        order = np.lexsort((detail, level))
        order = order[inside[order]]
        rank = np.arange(len(order)) - np.searchsorted(level[order], level[order])
        picked = np.sort(order[rank < _PER_LEVEL])
        return cls(codes[picked].astype(float), around[picked].astype(float))

    @classmethod
    def joined(cls, several: "Sequence[Places]") -> "Places":
        """All of them."""
        return cls(
            np.concatenate([p.codes for p in several]), np.concatenate([p.around for p in several])
        )

    def some(self, count: int) -> "Places":
        """About `count` of them, evenly spread."""
        step = slice(None, None, max(1, len(self.codes) // count))
        return Places(self.codes[step], self.around[step])

    def usable(self, margin: float) -> Bools:
        """(N, pictures) neither clipped nor beside an edge."""
        inside = (self.codes > 0) & (self.codes < 1)
        inside &= (self.around > margin) & (self.around < 1 - margin)
        return np.asarray(inside & (np.abs(self.codes - self.around) < margin))

    def shared(self) -> bool:
        """Enough of them are seen in two pictures."""
        return int(np.sum(np.count_nonzero(self._inside, axis=1) >= 2)) >= _ENOUGH

    @property
    def _inside(self) -> Bools:
        return np.asarray((self.codes > 0) & (self.codes < 1))

    def check_shared(self, bracket: Bracket) -> None:
        """Raise unless the pictures hang together, and longer exposures are brighter.

        Raises
        ------
        ResponseError
        """
        inside = self._inside
        for first, second in zip(
            range(len(bracket.names)), range(1, len(bracket.names)), strict=False
        ):
            names = f"{bracket.names[first]} and {bracket.names[second]}"
            both = inside[:, first] & inside[:, second]
            if np.count_nonzero(both) < _ENOUGH:
                raise ResponseError(
                    f"{names} have no code values in common: where one is neither black nor "
                    "clipped the other is; take pictures with exposures in between"
                )
            rise = float(np.median(self.codes[both, second] - self.codes[both, first]))
            if rise < _BRIGHTER and bracket.times[second] > 1.05 * bracket.times[first]:
                raise ResponseError(
                    f"{names} are equally bright, or the second darker, although it was exposed "
                    "longer; check the exposure times, and that aperture, ISO and light stayed"
                )


def _check_codes(name: str, picture: LinearImage) -> None:
    transfer = picture.meta.transfer
    if transfer is not None and transfer.name != "linear":
        raise ValueError(
            f"{name} was decoded as {transfer.name}; its code values are needed as they are: "
            "read it with blurmatte.read(path, blurmatte.LINEAR)"
        )


def _times(
    pictures: Sequence[LinearImage], names: Sequence[str], given: Sequence[float] | None
) -> Array:
    if given is None:
        missing = [n for n, p in zip(names, pictures, strict=True) if p.meta.exposure_time is None]
        if missing:
            raise ValueError(
                f"{missing[0]} does not tell its exposure time; give exposure_times "
                "(--exposures 1/60,1/15), one for each picture"
            )
        given = [p.meta.exposure_time or 0.0 for p in pictures]
    times = np.asarray(given, dtype=float)
    if times.shape != (len(pictures),):
        raise ValueError(f"exposure_times must be {len(pictures)} numbers, got {len(given)}")
    if not np.all(np.isfinite(times) & (times > 0)):
        raise ValueError(f"exposure_times must be positive seconds, got {times.tolist()}")
    return times
