"""Linear light of Blender Cycles → the files of several cameras, with the truth.

The picture is composed here: image = (1 - alpha) · plate · field + light. So alpha and light are
exactly those of the picture, whatever the renderer's sampling noise is. The lens of a camera blurs
image, plate, alpha and light alike.
"""

import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from benchmarks.cycles.catalog import TIME, scene
from benchmarks.cycles.pictures import CYCLES, Facts, Picture, TrueShot, write_picture

from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage, NoiseModel
from blurmatte.rendering import Camera
from blurmatte.rendering.processing import Processing, encode_codes
from blurmatte.rendering.shot import Drift, photograph_pair
from blurmatte.trajectory import Trajectory

Light = npt.NDArray[np.floating[Any]]
Maps = dict[str, npt.NDArray[np.float32]]
Content = bytes | npt.NDArray[np.uint8] | LinearImage  # of a file

NOISE = NoiseModel(gain=6e-5, read_std=0.001)  # about one code value of 8 bits at middle light
MORE_NOISE = NoiseModel(gain=1.5e-4, read_std=0.0015)


@dataclass(frozen=True)
class Setup:
    """A camera, and what happened between its two pictures.

    Parameters
    ----------
    camera : Camera
    camera_class : str
        "png", "phone", or another.
    shift : float
        Pixels by which the plate's picture is displaced, in a direction of chance.
    gain_std : float
        Standard deviation of the exposure's change, relative.
    plate_frames : int
        The plate is the median of so many pictures.
    crf : float, optional
        Both are frames of one H.264 clip of this constant rate factor.
    number : int, optional
        It takes only so many scenes of each kind.
    """

    camera: Camera
    camera_class: str
    shift: float = 0.0
    gain_std: float = 0.0
    plate_frames: int = 1
    crf: float | None = None
    number: int | None = None


def _phone(quality: int, blur: float, processing: Processing, noise: NoiseModel = NOISE) -> Camera:
    return Camera(noise, blur=blur, processing=processing, jpeg_quality=quality, chroma="4:2:0")


SETUPS: dict[str, dict[str, Setup]] = {
    "learn": {
        "png": Setup(Camera(NOISE), "png"),
        "phone": Setup(_phone(90, 0.6, Processing(0.8, 0.0, 0.4)), "phone", 0.3, 0.002),
        "raw": Setup(Camera(MORE_NOISE, bits=16, bayer=True), "Bayer, 16 bits", number=2),
        "noisy": Setup(Camera(MORE_NOISE), "png, more noise", plate_frames=5, number=2),
    },
    "tune": {
        "png": Setup(Camera(NOISE, blur=0.5), "png"),
        "phone": Setup(_phone(95, 0.9, Processing(1.2, 0.0, 0.7, 1.3)), "phone", 0.25, 0.003),
        "clip": Setup(Camera(NOISE), "H.264 clip", plate_frames=5, crf=20, number=2),
        "tone": Setup(
            _phone(92, 0.5, Processing(0.5, 0.3, 0.3)), "phone, tone curve", 0.2, number=2
        ),
    },
    "sealed": {
        "png": Setup(Camera(NOISE, defocus=0.8), "png"),
        "phone": Setup(
            _phone(85, 0.7, Processing(1.0, 0.0, 0.8), MORE_NOISE), "phone", 0.35, 0.003
        ),
        "camera": Setup(
            Camera(NOISE, jpeg_quality=98, chroma="4:4:4"), "JPEG 98, 4:4:4", 0.1, 0.001, number=2
        ),
        "deep": Setup(Camera(NOISE, bits=16), "png, 16 bits", number=2),
    },
}


def photograph_scene(root: Path, name: str) -> int:
    """Photograph one rendered scene with all cameras of its part; how many pictures were written."""
    job = json.loads((root / "linear" / f"{name}.json").read_text(encoding="utf-8"))
    number = int(name.rsplit("_", 1)[1])
    missing = [
        (picture, setup)
        for camera, setup in SETUPS[job["part"]].items()
        if (setup.number is None or number < setup.number)
        and not (picture := Picture(root, job["part"], name, camera)).whole
    ]
    if missing:
        with (
            np.load(root / "linear" / f"{name}.npz") as scene,
            np.load(root / "plates" / f"{job['plate']}.npz") as place,
        ):
            maps = composed(dict(scene), dict(place))
        for picture, setup in missing:
            _write(picture, setup, maps, job)
    return len(missing)


def composed(scene: Maps, place: Maps) -> Maps:
    """Maps of the picture in its full size: plate, behind, image, alpha and light, and the first's."""
    plate = place["light"]
    behind = plate * enlarged(scene["field"], plate.shape[:2])
    image = (1 - scene["alpha"][..., None]) * behind + scene["light"]
    kept = {key: value for key, value in scene.items() if key != "field"}
    return kept | {"plate": plate, "behind": behind, "image": image}


def enlarged(field: npt.NDArray[np.float32], shape: tuple[int, int]) -> npt.NDArray[np.float32]:
    """The light field (h, w, 3), interpolated linearly to (H, W, 3)."""
    from scipy.ndimage import zoom

    factors = (shape[0] / field.shape[0], shape[1] / field.shape[1], 1)
    wide = zoom(field, factors, order=1, mode="nearest", grid_mode=True)
    return np.asarray(wide, np.float32)


def _write(picture: Picture, setup: Setup, maps: Maps, job: Mapping[str, Any]) -> None:
    files = camera_files(setup, maps["image"], maps["plate"], f"{picture.scene} {picture.camera}")
    write_picture(picture, files, _shot(setup.camera, maps, job), _facts(setup, maps, job))


def camera_files(setup: Setup, image: Light, plate: Light, name: str) -> dict[str, Content]:
    """What the files of image and plate hold, by their names.

    Parameters
    ----------
    setup : Setup
    image, plate : (H, W, 3) float
        Linear light before the lens.
    name : str
        Seeds noise, drift and change of exposure.
    """
    rng, camera = np.random.default_rng(zlib.crc32(name.encode())), setup.camera
    angle, gain = rng.uniform(0, 2 * np.pi), 1 + setup.gain_std * rng.standard_normal()
    shift = (setup.shift * np.cos(angle), setup.shift * np.sin(angle))
    lights = (image, Drift(shift, gain=(gain, gain, gain)).apply(plate))
    names = ("image", "plate")
    if camera.jpeg_quality is not None:
        files = [camera.compress(camera.expose(light, rng)) for light in lights]
        return {f"{name}.jpg": file for name, file in zip(names, files, strict=True)}
    pictures = photograph_pair(camera, *lights, rng, setup.plate_frames, setup.crf)
    found = [p if camera.bits == 16 else encode_codes(p.rgb, 8) for p in pictures]
    return {f"{name}.png": file for name, file in zip(names, found, strict=True)}


def _shot(camera: Camera, maps: Maps, job: Mapping[str, Any]) -> TrueShot:
    seen = {name: camera.through_optics(values) for name, values in maps.items()}
    made, first = scene(job["kind"], int(job["name"].rsplit("_", 1)[1])), None
    if "alpha_first" in seen:
        first = Layer(seen["alpha_first"], seen["light_first"])
    return TrueShot(
        Layer(seen["alpha"], seen["light"]),
        LinearImage(seen["image"]),
        LinearImage(seen["behind"]),
        Trajectory(made.path, TIME),
        made.radius_px,
        None,
        first,
    )


def _facts(setup: Setup, maps: Maps, job: Mapping[str, Any]) -> Facts:
    red, green, blue = (
        maps["light"].sum(axis=(0, 1), dtype=float) / maps["alpha"].sum(dtype=float)
    ).tolist()
    return Facts(
        kind=job["kind"],
        room=job["place"]["room"],
        camera_class=setup.camera_class,
        renderer=CYCLES,
        round=job["round"] and not job["rolling_shutter"],
        alpha_std=job["alpha_std"],
        mean_color=(red, green, blue),
        light_std=job["alpha_std"] * max(red, green, blue),
    )


def photograph(root: Path, names: Iterable[str] | None = None) -> int:
    """Photograph some rendered scenes, or all; how many pictures were written."""
    if names is None:
        names = sorted(path.stem for path in (root / "linear").glob("*.json"))
    return sum(photograph_scene(root, name) for name in names)
