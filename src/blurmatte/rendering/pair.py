"""Image and plate of any renderer, as the files of one camera give them back."""

from dataclasses import replace

import numpy as np

from blurmatte.checks import Floats, check_light, check_same_size
from blurmatte.radiometry import LinearImage, decode
from blurmatte.rendering.camera import Camera
from blurmatte.rendering.sensor import Rng
from blurmatte.rendering.video import through_h264


def photograph_pair(
    camera: Camera,
    image: Floats,
    plate: Floats,
    rng: Rng,
    plate_frames: int = 1,
    crf: float | None = None,
) -> tuple[LinearImage, LinearImage]:
    """Photograph the image, then the plate once or several times.

    Parameters
    ----------
    camera : Camera
        With `crf`, one of 8 bits without JPEG.
    image, plate : (H, W, 3) float
        Exact linear light, 1 = sensor white.
    rng : int or Generator
        Seed, or a generator that is used up. The image takes the first numbers: it has the same
        noise however many frames the plate has.
    plate_frames : int
        The plate is the median of so many pictures, 1 or more.
    crf : float, optional
        All are frames of one H.264 clip of this constant rate factor (see `through_h264`): half of the
        plate's frames, the image, the other half.

    Returns
    -------
    image, plate : LinearImage
        As `Camera.photograph` gives them. The noise of a plate of several frames is not known, since a
        median has no simple model.

    Raises
    ------
    TypeError, ValueError
        If they are not linear light of one size, `plate_frames` < 1, or the camera cannot make the
        frames of a clip.
    """
    check_light("image", image)
    check_light("plate", plate)
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
    """All pictures through one clip, in which the first stands in the middle of the others."""
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
