"""What a sweep is fitted to: light and noise of a box of the picture, at any coarseness."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry import (
    Compression,
    LinearImage,
    Transfer,
    cell_means,
    smooth_variance,
    with_noise,
)
from blurmatte.streaks import Streak
from blurmatte.sweep.chroma import Bled, Blur, Compressed
from blurmatte.sweep.known import KnownColor

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_FINE = 25.0  # codes, in the median of chroma: qualities of 88 and more
_FAR = 0.1  # what pixels far from a streak count, lest the noise of many says more than the streak


@dataclass(frozen=True, eq=False)
class Data:
    """Image and plate within a box.

    Parameters
    ----------
    C, B : (h, w, 3) float
        Light.
    C_variance, B_variance : (h, w, 3) float
        Noise.
    weight : (h, w) float
        How much a pixel counts: 1, less far from the streak, 0 where nothing is to be believed.
    valid : (h, w) bool
        Where there is something to be believed.
    streak : (h, w) bool
        Where something is known to have moved.
    near : (h, w) bool
        Where it may have moved besides.
    size : (float, float)
        (width, height) of the picture, in its pixels.
    origin : (float, float)
        Where the center of pixel (0, 0) is, in pixels of the picture.
    known : KnownColor, optional
        What is known of the object's color.
    scale : float
        Width of a pixel here, in pixels of the picture.
    grain : float
        Over how many pixels of the picture an object of any colors is taken to change little.
    louder : float
        Times the variance that was measured, which the noise is taken to have.
    compression : Compression, optional
        Of the image's file, of which these are the pixels; see `Meta.sharing`.
    """

    C: Array
    B: Array
    C_variance: Array
    B_variance: Array
    weight: Array
    valid: Bools
    streak: Bools
    near: Bools
    size: tuple[float, float]
    origin: tuple[float, float]
    known: KnownColor | None = None
    scale: float = 1.0
    grain: float = 4.0
    louder: float = 1.0
    compression: Compression | None = None

    @property
    def pitch(self) -> float:
        """`grain` in the pixels here, 2 or more."""
        return max(self.grain / self.scale, 2.0)

    @property
    def of_fine_file(self) -> bool:
        """Whether the image's file says how it was compressed, in steps that leave but noise.

        In coarser ones what the plate's own file did to it is as large.
        """
        compression = self.compression
        return compression is not None and bool(np.median(compression.chroma) <= _FINE)

    def before_bleeding(
        self, alpha: Array, within: Array, blur: float, transfer: Transfer
    ) -> "Data":
        """With the light before colors ran together by so many pixels; see `chroma`."""
        bled = Bled(self.C, self.B, Blur(blur / self.scale), transfer)
        return self.with_light(bled.before(alpha, within))

    def bled(self, transfer: Transfer) -> Bled:
        """What a file that says how it was compressed made of the colors; see `chroma`."""
        assert self.compression is not None
        variance = self.C_variance / self.louder
        file = Compressed.of(self.compression, self.C, variance, transfer)
        return Bled(self.C, self.B, file, transfer)

    def with_light(self, C: Array) -> "Data":
        """With other light of the image."""
        return replace(self, C=np.ascontiguousarray(C))

    def raised(self, by: float) -> "Data":
        """With that many times the variance of noise."""
        C_variance, B_variance = by * self.C_variance, by * self.B_variance
        return replace(self, C_variance=C_variance, B_variance=B_variance, louder=by * self.louder)

    def with_noise_measured(self) -> "Data":
        """With the noise that there is between these pixels beside the streak.

        Of what files make hang together it is more than means over pixels of the file should have.
        """
        pictures = with_noise(*(LinearImage(light, valid=self.valid) for light in (self.C, self.B)))
        C_variance, B_variance = (self.louder * smooth_variance(p) for p in pictures)
        return replace(self, C_variance=C_variance, B_variance=B_variance)

    def coarse_enough(self, radius: float, pixels: float) -> "Data":
        """On pixels so large that a radius (pixels of the picture) has that many, or a few more."""
        return self.coarser(max(1, int(radius / (pixels * self.scale))))

    def coarser(self, by: int) -> "Data":
        """Means over blocks of `by` by `by` pixels; what is left over at the far sides is cut."""
        if by == 1:
            return self

        def means(x: Array) -> Array:
            return np.asarray(cell_means(x, by), dtype=float)

        middle = (by - 1) / 2 * self.scale
        return Data(
            means(self.C),
            means(self.B),
            means(self.C_variance) / by**2,
            means(self.B_variance) / by**2,
            np.where(means(self.valid.astype(float)) == 1, means(self.weight), 0),
            means(self.valid.astype(float)) == 1,
            means(self.streak.astype(float)) > 0,
            means(self.near.astype(float)) > 0,
            self.size,
            (self.origin[0] + middle, self.origin[1] + middle),
            self.known,
            self.scale * by,
            self.grain,
            self.louder,
        )


def nothing_in(box: tuple[int, int, int, int], size: tuple[int, int]) -> Data:
    """Where the pixels of a box (x0, y0, x1, y1) of a picture are, without any light."""
    x0, y0, x1, y1 = box
    no_light, one = np.zeros((y1 - y0, x1 - x0, 0)), np.ones((y1 - y0, x1 - x0))
    origin = float(x0), float(y0)
    everywhere = one > 0
    return Data(
        no_light,
        no_light,
        no_light,
        no_light,
        one,
        everywhere,
        everywhere,
        everywhere,
        size,
        origin,
    )


def data_around(
    streak: Streak,
    margin: int,
    image: LinearImage,
    plate: LinearImage,
    known: KnownColor | None,
) -> Data:
    """The data of a streak and some pixels around it, of two pictures whose noise is known."""
    from scipy.ndimage import distance_transform_edt

    box, size = streak.around(margin), image.size
    image, plate = image.crop(box), plate.crop(box)
    mask = streak.mask[box[1] : box[3], box[0] : box[2]]
    valid = image.valid & plate.valid
    near = (distance_transform_edt(~mask) <= margin) | ~valid
    return Data(
        np.ascontiguousarray(image.rgb, dtype=float),
        np.ascontiguousarray(plate.rgb, dtype=float),
        smooth_variance(image),
        smooth_variance(plate),
        np.where(valid, np.where(near, 1, _FAR), 0),
        valid,
        mask,
        near,
        size,
        (float(box[0]), float(box[1])),
        known,
        compression=image.meta.sharing,
    )
