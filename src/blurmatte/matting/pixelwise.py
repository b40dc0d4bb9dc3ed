"""Pixelwise: the closed form of each pixel alone, in threads over strips of rows."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from blurmatte.checks import Codes, Codes8, Floats, check_map
from blurmatte.color.model import ColorModel
from blurmatte.matting import pixelwise_kernel as kernel
from blurmatte.matting.maps import MIN_VARIANCE, PixelMaps, Quality, in_strips
from blurmatte.radiometry import NoiseModel


@dataclass(frozen=True)
class Pixelwise:
    """Solve each pixel alone, in closed form ([GC07 §3.2], weighted by the noise).

    Parameters
    ----------
    max_alpha_std : float
        A pixel whose alpha is less certain than this is marked PLATE_IN_MODEL, > 0.
    """

    max_alpha_std: float = 0.3

    def __post_init__(self) -> None:
        if not self.max_alpha_std > 0:
            raise ValueError(f"max_alpha_std must be positive, got {self.max_alpha_std}")

    def __call__(
        self,
        image: Floats | Codes,
        plate: Floats | Codes,
        model: ColorModel,
        image_noise: NoiseModel | Floats,
        plate_noise: NoiseModel | Floats,
        flags: Codes8 | None = None,
        tables: tuple[Floats, Floats] | None = None,
        out: PixelMaps | None = None,
    ) -> PixelMaps:
        """Alpha and premultiplied light of every pixel; NumPy in, NumPy out.

        Parameters
        ----------
        image, plate : (H, W, 3)
            Linear light as floats; or code values, uint8 or uint16, decoded by `tables`.
        model : ColorModel
            With a model of rank 3 a single pixel has no information: alpha is 0, its error infinite.
        image_noise, plate_noise : NoiseModel or (H, W, 3) variances
            Variances per pixel are for light only, not for code values.
        flags : (H, W) uint8, optional
            `Quality` bits already known; the result keeps them.
        tables : two (levels,) floats, optional
            Linear light of each code value of image and plate (`Transfer.table`).
        out : PixelMaps, optional
            Arrays to write to; their dtype is that of the computation. New arrays take twice as long.

        Returns
        -------
        PixelMaps
            Raw estimates, neither clipped nor masked.
        """
        height, width = image.shape[:2]
        dtype = (tables[0] if tables else image).dtype if out is None else out.alpha.dtype
        maps = PixelMaps.empty(height, width, dtype) if out is None else out
        check_map("out", maps.premultiplied, (height, width, 3))
        if model.rank == 3:
            return _unknown(maps, flags)
        N = _normals(model, dtype)
        max_std = dtype.type(self.max_alpha_std)

        def solve_rows(rows: slice) -> None:
            """Solve some rows."""
            maps.quality[rows] = 0 if flags is None else flags[rows]
            noise = [
                n if isinstance(n, NoiseModel) else n[rows] for n in (image_noise, plate_noise)
            ]
            solve, arguments = _compiled(image[rows], plate[rows], noise, tables, dtype)
            solve(*arguments, N, max_std, tuple(np.reshape(m[rows], -1) for m in maps))

        in_strips(solve_rows, height)
        return maps


def _unknown(maps: PixelMaps, flags: Codes8 | None) -> PixelMaps:
    """Alpha and light 0 with an infinite error."""
    for values, stds in (
        (maps.alpha, maps.alpha_std),
        (maps.premultiplied, maps.premultiplied_std),
    ):
        values[:], stds[:] = 0, np.inf
    maps.quality[:] = (0 if flags is None else flags) | np.uint8(Quality.PLATE_IN_MODEL)
    return maps


def _compiled(
    image: Any, plate: Any, noise: list[NoiseModel | Floats], tables: Any, dtype: np.dtype[Any]
) -> tuple[Callable[..., None], tuple[Any, ...]]:
    """The compiled loop for this kind of input, and its arguments from image to noise."""
    C, B = (np.ascontiguousarray(a).reshape(-1) for a in (image, plate))
    if tables is not None:
        light = tuple(np.asarray(table, dtype) for table in tables)
        return kernel.solve_codes, ((C, B), light, *(_coefficients(n, dtype) for n in noise))
    C, B = (a.astype(dtype, copy=False) for a in (C, B))
    if all(isinstance(n, NoiseModel) for n in noise):
        return kernel.solve_light, (C, B, *(_coefficients(n, dtype) for n in noise))
    variances = (
        (n.variance(light) if isinstance(n, NoiseModel) else n) + MIN_VARIANCE
        for n, light in zip(noise, (image, plate), strict=True)
    )
    return kernel.solve_light_with_variances, (
        C, B, *(np.ascontiguousarray(v, dtype).reshape(-1) for v in variances),
    )  # fmt: skip


def _normals(model: ColorModel, dtype: np.dtype[Any]) -> tuple[Any, ...]:
    """Six numbers of two normals and the variance added to the second, which is zero for a plane."""
    normals = np.zeros((2, 3))
    normals[: 3 - model.rank] = model.normals.T
    return tuple(dtype.type(x) for x in (*normals.ravel(), model.rank - 1))


def _coefficients(noise: NoiseModel | Floats, dtype: np.dtype[Any]) -> tuple[Any, ...]:
    """Nine numbers of a noise model: those of 1, light and light² of each channel."""
    if not isinstance(noise, NoiseModel):
        raise TypeError("code values need a NoiseModel, not a variance for each pixel")
    coefficients = noise.coefficients.copy()
    coefficients[:, 0] += MIN_VARIANCE
    return tuple(dtype.type(x) for x in coefficients.ravel())
