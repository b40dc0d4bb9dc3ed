"""Shot: a scene, its camera, and the differences between image and plate that are not the object."""

from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from blurmatte.checks import Floats, check_kind, check_light, check_same_size
from blurmatte.radiometry import LinearImage, decode
from blurmatte.rendering.camera import Camera
from blurmatte.rendering.processing import Rng, check_crf, through_h264
from blurmatte.rendering.render import Rendering
from blurmatte.rendering.scene import Scene, check_scene


@dataclass(frozen=True)
class Drift:
    """Changes between image and plate: camera motion, exposure, white balance.

    Parameters
    ----------
    shift : (float, float)
        Pixels, x right and y down: the point p of the image is at p + shift in the plate's picture.
    rotation : float
        Radians about the center of the picture, before the shift; x turns towards y.
    gain : (float, float, float)
        Brightness of the plate's picture relative to the image, per channel.

    Raises
    ------
    ValueError
        For numbers that are not finite, or a gain that is not positive.
    """

    shift: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)

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
        """Apply the drift to the exact linear light (H, W, 3) of a plate; the same array if none.

        Interpolation is by a spline of order 5, the least blurring one of SciPy, so light may ring
        below 0 at hard edges. It is not clipped. The picture is mirrored at its border.
        """
        light = check_light("light", light)
        if any(self.shift) or self.rotation:
            light = self._moved(light)
        if self.gain != (1, 1, 1):
            light = light * np.asarray(self.gain, dtype=light.dtype)
        return light

    def _moved(self, light: Floats) -> Floats:
        c, s = np.cos(self.rotation), np.sin(self.rotation)
        back = np.array([[c, -s], [s, c]])  # of (y, x), from the plate's picture to the image
        center = (np.array(light.shape[:2]) - 1) / 2
        offset = center - back @ (center + self.shift[::-1])
        moved = [
            scipy.ndimage.affine_transform(
                light[..., channel], back, offset, order=5, mode="mirror"
            )
            for channel in range(3)
        ]
        return np.stack(moved, axis=-1)


@dataclass(frozen=True, eq=False)
class Shot:
    """A scene, the camera, and the drift between image and plate.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    drift : Drift
        Change of the plate's picture relative to the plate behind the body.
    plate_frames : int
        Number of pictures whose median is the plate.
    seed : int
        Seed of the noise.
    crf : float, optional
        Image and plate are frames of one H.264 clip of this constant rate factor, 0…51.

    Raises
    ------
    ValueError
        If `plate_frames` < 1 or `crf` is outside its range.

    Examples
    --------
    >>> shot = bm.rendering.Shot(scene, camera, plate_frames=3, seed=7)
    >>> picture, plate = shot.photograph(truth)
    """

    scene: Scene
    camera: Camera = field(default_factory=Camera)
    drift: Drift = field(default_factory=Drift)
    plate_frames: int = 1
    seed: int = 0
    crf: float | None = None

    def __post_init__(self) -> None:
        check_scene("scene", self.scene)
        if self.plate_frames < 1:
            raise ValueError(f"plate_frames must be 1 or more, got {self.plate_frames}")
        if self.crf is not None:
            check_crf(self.crf)

    def photograph(self, rendering: Rendering) -> tuple[LinearImage, LinearImage]:
        """Image and plate of a rendering of its scene, decoded from files; see `photograph_pair`."""
        check_kind("rendering", rendering, Rendering, "use blurmatte.rendering.render(scene)")
        behind = self.drift.apply(rendering.plate.rgb)
        return photograph_pair(
            self.camera, rendering.image.rgb, behind, self.seed, self.plate_frames, self.crf
        )


def photograph_pair(
    camera: Camera,
    image: Floats,
    plate: Floats,
    rng: Rng,
    plate_frames: int = 1,
    crf: float | None = None,
) -> tuple[LinearImage, LinearImage]:
    """Photograph an image and its plate, exact linear light of any renderer.

    The image is drawn first, so its noise does not depend on the number of plate frames, whose median
    is the plate; the noise of a median is unknown. With `crf` all are frames of one H.264 clip of this
    constant rate factor (see `through_h264`) of a camera of 8 bits without JPEG: half of the plate's
    frames, the image, the other half. Raises TypeError or ValueError as `Camera.photograph`, and for
    different sizes.
    """
    image, plate = check_light("image", image), check_light("plate", plate)
    check_same_size("image", image.shape[1::-1], "plate", plate.shape[1::-1])
    if plate_frames < 1:
        raise ValueError(f"plate_frames must be 1 or more, got {plate_frames}")
    rng = np.random.default_rng(rng)
    lights = [image] + [plate] * plate_frames
    if crf is None:
        first, *frames = (camera.photograph(light, rng) for light in lights)
    else:
        first, *frames = _filmed(camera, lights, rng, crf)
    return first, _median(frames)


def _filmed(
    camera: Camera, lights: list[Floats], rng: np.random.Generator, crf: float
) -> list[LinearImage]:
    """Encode all pictures as one clip, with the first in the middle of the others."""
    if camera.bits != 8 or camera.jpeg_quality is not None:
        raise ValueError(
            "the frames of an H.264 clip hold 8 bits and are no JPEG files, got bits "
            f"{camera.bits} and jpeg_quality {camera.jpeg_quality}"
        )
    image, *plates = (camera.expose(light, rng).astype(np.uint8) for light in lights)
    before = (len(plates) + 1) // 2
    frames = through_h264([*plates[:before], image, *plates[before:]], crf)
    in_order = [frames[before], *frames[:before], *frames[before + 1 :]]
    return [decode(codes, camera.transfer) for codes in in_order]


def _median(frames: list[LinearImage]) -> LinearImage:
    if len(frames) == 1:
        return frames[0]
    rgb = np.median([frame.rgb for frame in frames], axis=0)
    valid = np.median([frame.valid for frame in frames], axis=0) > 0.5
    return replace(frames[0], rgb=rgb, noise=None, valid=valid)
