"""Drift: how the plate's picture differs from the plate that was behind the object."""

from dataclasses import dataclass

import numpy as np

from blurmatte.checks import Floats, check_light

_NOTHING = (0.0, 0.0)
_NO_GAIN = (1.0, 1.0, 1.0)
_ORDER = 5  # of the spline: the highest there is, and it blurs least


@dataclass(frozen=True)
class Drift:
    """What came between the two pictures: the camera moved, its exposure or white balance changed.

    Parameters
    ----------
    shift : (float, float)
        Pixels, x right and y down: what is at p in the image is at p + shift in the plate's picture.
    rotation : float
        Radians about the center of the picture, before the shift; x turns towards y.
    gain : (float, float, float)
        The plate's picture is this many times as bright, per channel.

    Raises
    ------
    ValueError
        For numbers that are not finite, or a gain that is not positive.
    """

    shift: tuple[float, float] = _NOTHING
    rotation: float = 0.0
    gain: tuple[float, float, float] = _NO_GAIN

    def __post_init__(self) -> None:
        for name, count in (("shift", 2), ("gain", 3)):
            numbers = np.asarray(getattr(self, name), dtype=float)
            if numbers.shape != (count,) or not np.all(np.isfinite(numbers)):
                raise ValueError(f"{name} must be {count} finite numbers, got {numbers.tolist()}")
            object.__setattr__(self, name, tuple(numbers.tolist()))
        if min(self.gain) <= 0:
            raise ValueError(f"gain must be positive, got {list(self.gain)}")
        if not np.isfinite(self.rotation):
            raise ValueError(f"rotation must be finite, got {self.rotation}")

    def apply(self, light: Floats) -> Floats:
        """The plate as its own picture shows it; the very same array if nothing drifted.

        Between pixels a spline of order 5 is read, so light may ring below 0 beside a hard edge. It
        is not clipped. What comes in at the border is the picture mirrored there.

        Parameters
        ----------
        light : (H, W, 3) float
            Exact linear light of the plate that was behind the object.

        Returns
        -------
        (H, W, 3) float
            In the dtype of `light`.

        Raises
        ------
        TypeError, ValueError
            If `light` is not linear light.
        """
        check_light("light", light)
        if self.shift != _NOTHING or self.rotation:
            light = self._moved(light)
        if self.gain != _NO_GAIN:
            light = light * np.asarray(self.gain, dtype=light.dtype)
        return light

    def _moved(self, light: Floats) -> Floats:
        from scipy.ndimage import affine_transform

        c, s = np.cos(self.rotation), np.sin(self.rotation)
        back = np.array([[c, -s], [s, c]])  # of (y, x), from the plate's picture to the image
        center = (np.array(light.shape[:2]) - 1) / 2
        offset = center - back @ (center + self.shift[::-1])
        moved = [
            affine_transform(light[..., channel], back, offset, order=_ORDER, mode="mirror")
            for channel in range(3)
        ]
        return np.stack(moved, axis=-1)
