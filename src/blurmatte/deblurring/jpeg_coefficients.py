"""The numbers that a JPEG file stores of a picture, as linear functions of its code values.

In this file Y is luma, Cb and Cr are chroma [T.871], R, G and B code values 0…255. A file stores the
cosine transforms of blocks of 8 by 8 pixels, of chroma after averaging the pixels that share it, each
rounded to a multiple of its step q: with a variance of q²/12 about the picture's. Decoders interpolate
chroma linearly.

This is the linear part of `radiometry.Compression`, which simulates a file with its rounding: a
likelihood needs derivatives. All of it is separable: a component x (h, w) has the coefficients R x Cᵀ,
with sparse matrices R and C of whole coded units, of which the picture shows a part.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from blurmatte.checks import Array
from blurmatte.radiometry import LUMA_WEIGHTS, YCBCR, Compression
from blurmatte.radiometry.compression import BLOCK
from blurmatte.statistics import UNIFORM_VARIANCE

Matrix = Any  # scipy.sparse.csr_matrix


@dataclass(frozen=True)
class _Axis:
    """Matrices along an axis: `size` pixels from `start` in whole units, `shared` with one chroma."""

    size: int
    start: int
    shared: int

    @property
    def whole(self) -> int:
        """Pixels of the whole units."""
        unit = BLOCK * self.shared
        return -(-(self.start + self.size) // unit) * unit

    def part(self, matrix: Matrix) -> Matrix:
        """The columns of the pixels shown."""
        return matrix[:, self.start : self.start + self.size]

    @cached_property
    def luma(self) -> Matrix:
        """Pixels → coefficients of luma."""
        return self.part(_cosines(self.whole))

    @cached_property
    def mean(self) -> Matrix:
        """Pixels of the units → their chroma."""
        number = self.whole // self.shared
        return scipy.sparse.kron(
            scipy.sparse.identity(number), np.full((1, self.shared), 1 / self.shared), format="csr"
        )

    @cached_property
    def interpolated(self) -> Matrix:
        """Chroma → pixels of the units; pairs are 3/4 their own and 1/4 the next one's."""
        number = self.whole // self.shared
        if self.shared == 1:
            return scipy.sparse.identity(number, format="csr")
        pixel = np.arange(self.whole)
        own = pixel // 2
        other = np.clip(own + 2 * (pixel % 2) - 1, 0, number - 1)
        weights = np.concatenate([np.full(self.whole, 0.75), np.full(self.whole, 0.25)])
        places = np.concatenate([pixel, pixel]), np.concatenate([own, other])
        return scipy.sparse.csr_matrix((weights, places), shape=(self.whole, number))

    @cached_property
    def chroma(self) -> Matrix:
        """Pixels before the file → coefficients of chroma."""
        return self.part(_cosines(self.whole // self.shared) @ self.mean)

    @cached_property
    def stored(self) -> Array:
        """Pixels after the file → coefficients of chroma, (k, size): interpolation is inverted."""
        smoothing = (self.mean @ self.interpolated).toarray()
        cosines = _cosines(self.whole // self.shared).toarray()
        return np.asarray(self.part(cosines @ np.linalg.solve(smoothing, self.mean.toarray())))

    @cached_property
    def seen(self) -> Matrix:
        """Chroma of pixels before the file → after it; beyond the picture's edges as at them."""
        places = np.clip(np.arange(self.whole) - self.start, 0, self.size - 1)
        shape = self.whole, self.size
        edges = scipy.sparse.csr_matrix(
            (np.ones(self.whole), (np.arange(self.whole), places)), shape=shape
        )
        return (self.interpolated @ self.mean @ edges)[self.start : self.start + self.size]


def _cosines(count: int) -> Matrix:
    """Orthonormal cosine transform of blocks of so many pixels."""
    block = scipy.fft.dct(np.eye(BLOCK), axis=0, norm="ortho")
    return scipy.sparse.kron(scipy.sparse.identity(count // BLOCK), block, format="csr")


@dataclass(frozen=True, eq=False)
class Coefficients:
    """The transform of a part of a picture.

    Parameters
    ----------
    compression : Compression
        Its origin is that of the part.
    shape : (int, int)
        Height and width of the part.
    """

    compression: Compression
    shape: tuple[int, int]

    @cached_property
    def _axes(self) -> tuple[_Axis, _Axis]:
        """Vertical and horizontal."""
        x, y = (o % n for o, n in zip(self.compression.origin, self.compression.mcu, strict=True))
        across, down = self.compression.shared
        return _Axis(self.shape[0], y, down), _Axis(self.shape[1], x, across)

    @cached_property
    def _pairs(self) -> tuple[tuple[Matrix, Matrix], ...]:
        """R and C of Y, Cb, Cr."""
        vertical, horizontal = self._axes
        chroma = vertical.chroma, horizontal.chroma
        return (vertical.luma, horizontal.luma), chroma, chroma

    @cached_property
    def step_variances(self) -> tuple[Array, ...]:
        """Variance of rounding, q² / 12, of the coefficients of Y, Cb, Cr."""
        tables = self.compression.luma, self.compression.chroma, self.compression.chroma
        return tuple(
            np.tile(UNIFORM_VARIANCE * np.square(q), (R.shape[0] // BLOCK, C.shape[0] // BLOCK))
            for q, (R, C) in zip(tables, self._pairs, strict=True)
        )

    @cached_property
    def _transposed(self) -> list[tuple[Matrix, Matrix]]:
        return [(R.T.tocsr(), C.T.tocsr()) for R, C in self._pairs]

    @property
    def equally_noisy(self) -> Array:
        """(3, 3) from R, G, B to multiples of Y, Cb, Cr that a file rounds equally, of norm √3.

        A pixel of n that share a chroma sample has n times its variance.
        """
        shared = np.prod(self.compression.shared) ** np.array([0, 1, 1])
        variance = shared * [np.mean(one) for one in self.step_variances]
        T = YCBCR / np.sqrt(variance)[:, None]
        return np.asarray(T * np.sqrt(3) / np.linalg.norm(T))

    def of(self, codes: Array) -> list[Array]:
        """Coefficients of differences of code values (h, w, 3), 0 beyond the edges, before a file."""
        components = np.tensordot(YCBCR, codes, (1, 2))
        pairs = zip(components, self._pairs, strict=True)
        return [np.asarray((C @ (R @ x).T).T) for x, (R, C) in pairs]

    def stored(self, codes: Array) -> list[Array]:
        """Coefficients of differences of code values (h, w, 3) read from a file."""
        luma, *chroma = np.moveaxis(codes @ YCBCR.T, -1, 0)
        (R, C), (vertical, horizontal) = self._pairs[0], self._axes
        of_chroma = [vertical.stored @ x @ horizontal.stored.T for x in chroma]
        return [np.asarray((C @ (R @ luma).T).T), *of_chroma]

    def adjoint(self, coefficients: list[Array]) -> Array:
        """(h, w, 3) the adjoint of `of`."""
        pairs = zip(coefficients, self._transposed, strict=True)
        return np.asarray(np.stack([(C @ (R @ x).T).T for x, (R, C) in pairs], axis=-1) @ YCBCR)

    def variances(self, codes: Array) -> list[Array]:
        """Variances of the coefficients from those of independent code values (h, w, 3)."""
        components = np.moveaxis(codes @ np.square(YCBCR).T, -1, 0)
        pairs = zip(components, self._pairs, strict=True)
        return [np.asarray((C.power(2) @ (R.power(2) @ x).T).T) for x, (R, C) in pairs]

    def seen(self, codes: Array) -> Array:
        """Code values (h, w, 3) with the chroma that a file returns."""
        vertical, horizontal = self._axes
        luma = (codes @ LUMA_WEIGHTS)[..., None]
        chroma = [
            (horizontal.seen @ (vertical.seen @ x).T).T for x in np.moveaxis(codes - luma, -1, 0)
        ]
        return np.asarray(luma + np.stack(chroma, axis=-1))
