"""The harder scenes of blurmatte's own renderer, in the folders of the second truth.

Kinds and random draws are those of benchmarks/accuracy/verdict.py; the plate is one picture, not the
median of several, as with the scenes of the other renderer.
"""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from benchmarks.accuracy.verdict import FILES, FIRST, KINDS, Case, draw
from benchmarks.cycles.pictures import BLURMATTE, OWN, Facts, Picture, TrueShot, write_picture

from blurmatte.rendering import Ball, Camera, render

CAMERAS = {"png": FILES["PNG"], "phone": FILES["JPEG"]}
_ROOM = "random plate"
_NOISE_SEED = 11  # of the cameras, with the seed of the scene


def write_own(root: Path, count: int, cameras: Sequence[str] = tuple(CAMERAS)) -> int:
    """Render `count` scenes of every kind, photograph each, and write what is not there yet.

    Parameters
    ----------
    root : Path
    count : int
        Scenes of each kind; more later adds to them.
    cameras : sequence of str
        Of `CAMERAS`.

    Returns
    -------
    int
        How many pictures were written.
    """
    written, start = 0, time.monotonic()
    for seed in range(FIRST, FIRST + count):
        for kind, made in KINDS.items():
            name = f"{kind.replace(' ', '_')}_{seed}"
            missing = [p for c in cameras if not (p := Picture(root, OWN, name, c)).whole]
            if not missing:
                continue
            case = made(draw(seed))
            for picture in missing:
                _write(picture, case, kind, seed)
            written += len(missing)
            rate = 60 * written / max(time.monotonic() - start, 1e-3)
            print(f"{written} pictures, {rate:.0f} a minute", flush=True)
    return written


def _write(picture: Picture, case: Case, kind: str, seed: int) -> None:
    truth, scene = case.truth, case.truth.scene
    camera = CAMERAS[picture.camera]
    rng = np.random.default_rng([seed, _NOISE_SEED])
    lights = {"image": truth.image.rgb, "plate": truth.plate.rgb}
    files = dict(_file(name, light, camera, rng) for name, light in lights.items())
    radius, later = (max(scene.body.reach(scene.change.at(t))) for t in (0, 1))
    crossing = len(case.alphas) > 1
    shot = TrueShot(
        truth.layer,
        truth.image,
        truth.plate,
        truth.trajectory,
        radius,
        None if crossing else truth.model,
        render(scene).layer if crossing else None,
    )
    r, g, b = truth.layer.color.tolist()
    facts = Facts(
        kind=kind,
        room=_ROOM,
        camera_class=picture.camera,
        renderer=BLURMATTE,
        round=isinstance(scene.body, Ball) and bool(np.isclose(radius, later)) and not crossing,
        alpha_std=0.0,
        mean_color=(r, g, b),
    )
    write_picture(picture, files, shot, facts)


def _file(
    name: str, light: npt.NDArray[np.floating], camera: Camera, rng: np.random.Generator
) -> tuple[str, bytes | npt.NDArray[np.uint8]]:
    """Name and content of a picture's file."""
    codes = camera.expose(light, rng)
    if camera.jpeg_quality is None:
        return f"{name}.png", codes.astype(np.uint8)
    return f"{name}.jpg", camera.compress(codes)
