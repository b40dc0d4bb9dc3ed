"""The closed form: each pixel alone, all of them in threads over strips of rows."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from os import cpu_count
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats, check_map
from blurmatte.color import ColorModel
from blurmatte.matting.solution import Quality
from blurmatte.radiometry import NoiseModel

Codes = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

# Light is stored as float32, so no value is known better than to about 1e-6 of full scale. It also
# keeps the fit's weights finite where image and plate are exact.
LEAST_VARIANCE = 1e-12


class PixelMaps(NamedTuple):
    """What the closed form says of each pixel; reuse one as `out=` for the next picture.

    alpha, alpha_std are (H, W) floats, premultiplied and premultiplied_std (H, W, 3) floats, and
    quality (H, W) uint8 with the bits of `Quality`.
    """

    alpha: Floats
    alpha_std: Floats
    premultiplied: Floats
    premultiplied_std: Floats
    quality: npt.NDArray[np.uint8]

    @classmethod
    def empty(cls, height: int, width: int, dtype: npt.DTypeLike = np.float32) -> "PixelMaps":
        """Maps of a size, not filled."""
        one, three = (height, width), (height, width, 3)
        return cls(
            np.empty(one, dtype), np.empty(one, dtype),
            np.empty(three, dtype), np.empty(three, dtype), np.empty(one, np.uint8),
        )  # fmt: skip

    @classmethod
    def zeros(cls, height: int, width: int, dtype: npt.DTypeLike = np.float32) -> "PixelMaps":
        """Maps of a size, 0 ± 0; what is never written takes no memory."""
        one, three = (height, width), (height, width, 3)
        return cls(
            np.zeros(one, dtype), np.zeros(one, dtype),
            np.zeros(three, dtype), np.zeros(three, dtype), np.zeros(one, np.uint8),
        )  # fmt: skip

    @property
    def copied(self) -> "PixelMaps":
        """The same in arrays of its own; views keep those of the whole picture."""
        return PixelMaps(
            self.alpha.copy(), self.alpha_std.copy(),
            self.premultiplied.copy(), self.premultiplied_std.copy(), self.quality.copy(),
        )  # fmt: skip

    def write(self, box: tuple[int, int, int, int], maps: "PixelMaps") -> None:
        """Write the maps of a box (x0, y0, x1, y1) there."""
        for target, values in zip(self.within(box), maps, strict=True):
            target[...] = values

    def within(self, box: tuple[int, int, int, int]) -> "PixelMaps":
        """Views of a box (x0, y0, x1, y1)."""
        x0, y0, x1, y1 = box
        place = slice(y0, y1), slice(x0, x1)
        return PixelMaps(
            self.alpha[place], self.alpha_std[place],
            self.premultiplied[place], self.premultiplied_std[place], self.quality[place],
        )  # fmt: skip


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
        flags: npt.NDArray[np.uint8] | None = None,
        tables: tuple[Floats, Floats] | None = None,
        out: PixelMaps | None = None,
    ) -> PixelMaps:
        """Alpha and premultiplied light of every pixel; NumPy in, NumPy out.

        Parameters
        ----------
        image, plate : (H, W, 3)
            Linear light as floats; or code values, uint8 or uint16, decoded by `tables`.
        model : ColorModel
            Of one that holds all colors a pixel alone knows nothing: alpha is 0 and its error infinite.
        image_noise, plate_noise : NoiseModel or (H, W, 3) variances
            Variances per pixel are for light only, not for code values.
        flags : (H, W) uint8, optional
            `Quality` bits known beforehand; the result's `quality` starts from them.
        tables : two (levels,) floats, optional
            Linear light of each code value of image and plate (`Transfer.table`).
        out : PixelMaps, optional
            Where to write; its dtype is the one computed in. Filling fresh arrays takes twice as long.

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
            maps.quality[rows] = 0 if flags is None else flags[rows]
            noise = [
                n if isinstance(n, NoiseModel) else n[rows] for n in (image_noise, plate_noise)
            ]
            solve, arguments = _compiled(image[rows], plate[rows], noise, tables, dtype)
            solve(*arguments, N, max_std, *(np.reshape(m[rows], -1) for m in maps))

        in_strips(solve_rows, height)
        return maps


def _unknown(maps: PixelMaps, flags: npt.NDArray[np.uint8] | None) -> PixelMaps:
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
    """The compiled loop for this kind of input, and its arguments up to the noise."""
    from blurmatte.matting import kernel  # numba takes half a second to import

    C, B = (np.ascontiguousarray(a).reshape(-1) for a in (image, plate))
    if tables is not None:
        light = [np.asarray(table, dtype) for table in tables]
        return kernel.solve_codes, (C, B, *light, *(_coefficients(n, dtype) for n in noise))
    C, B = (a.astype(dtype, copy=False) for a in (C, B))
    if all(isinstance(n, NoiseModel) for n in noise):
        return kernel.solve_light, (C, B, *(_coefficients(n, dtype) for n in noise))
    variances = (
        (n.variance(light) if isinstance(n, NoiseModel) else n) + LEAST_VARIANCE
        for n, light in zip(noise, (image, plate), strict=True)
    )
    return kernel.solve_light_with_variances, (
        C, B, *(np.ascontiguousarray(v, dtype).reshape(-1) for v in variances),
    )  # fmt: skip


def in_strips(job: Callable[[slice], None], height: int) -> None:
    """Do a job on strips of rows, on all processors; its kernels let go of the interpreter."""
    with ThreadPoolExecutor(cpu_count()) as threads:
        list(threads.map(job, _strips(height)))


def _strips(height: int) -> list[slice]:
    """Strips of rows, a few for each processor, so that none waits long for the last."""
    edges = np.linspace(0, height, min(height, 8 * (cpu_count() or 1)) + 1).astype(int)
    return [slice(a, b) for a, b in pairwise(edges)]


def _normals(model: ColorModel, dtype: np.dtype[Any]) -> tuple[Any, ...]:
    """Six numbers of the two normals, the second zero for a plane, and the second's variance pad."""
    normals = np.zeros((2, 3))
    normals[: 3 - model.rank] = model.normals.T
    return tuple(dtype.type(x) for x in (*normals.ravel(), model.rank - 1))


def _coefficients(noise: NoiseModel | Floats, dtype: np.dtype[Any]) -> tuple[Any, ...]:
    if not isinstance(noise, NoiseModel):
        raise TypeError("code values need a NoiseModel, not a variance for each pixel")
    coefficients = noise.coefficients.copy()
    coefficients[:, 0] += LEAST_VARIANCE
    return tuple(dtype.type(x) for x in coefficients.ravel())
