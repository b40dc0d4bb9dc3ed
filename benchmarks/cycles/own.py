"""The harder scenes of blurmatte's own renderer, in the folders of the second truth.

Kinds and random draws are those of benchmarks/accuracy/verdict.py; the cameras are those of the part
learn, so that only the scenes and their renderer differ.
"""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from benchmarks.accuracy.verdict import FIRST, KINDS, Case, draw
from benchmarks.cycles.photograph import SETUPS, camera_files
from benchmarks.cycles.pictures import (
    BLURMATTE,
    LEARN,
    OWN,
    Facts,
    Picture,
    TrueShot,
    write_picture,
)

from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import Ball, Camera, render

CAMERAS = ("png", "phone")  # of the part learn
_ROOM = "random plate"


def write_own(
    root: Path, count: int, cameras: Sequence[str] = CAMERAS, kinds: Sequence[str] = tuple(KINDS)
) -> int:
    """Render `count` scenes of every kind, photograph each, and write what is not there yet.

    Parameters
    ----------
    root : Path
    count : int
        Scenes of each kind; more later adds to them.
    cameras : sequence of str
        Of `photograph.SETUPS["learn"]`.
    kinds : sequence of str
        Of `verdict.KINDS`.

    Returns
    -------
    int
        How many pictures were written.
    """
    written, start = 0, time.monotonic()
    for seed in range(FIRST, FIRST + count):
        for kind in kinds:
            name = f"{kind.replace(' ', '_')}_{seed}"
            missing = [p for c in cameras if not (p := Picture(root, OWN, name, c)).whole]
            if not missing:
                continue
            case = KINDS[kind](draw(seed))
            for picture in missing:
                _write(picture, case, kind)
            written += len(missing)
            rate = 60 * written / max(time.monotonic() - start, 1e-3)
            print(f"{written} pictures, {rate:.0f} a minute", flush=True)
    return written


def _write(picture: Picture, case: Case, kind: str) -> None:
    setup, truth = SETUPS[LEARN][picture.camera], case.truth
    files = camera_files(
        setup, truth.image.rgb, truth.plate.rgb, f"{picture.scene} {picture.camera}"
    )
    shot, scene = _true_shot(case, setup.camera), truth.scene
    first, last = (max(scene.body.reach(scene.change.at(t))) for t in (0, 1))
    r, g, b = truth.layer.color.tolist()
    facts = Facts(
        kind=kind,
        room=_ROOM,
        camera_class=setup.camera_class,
        renderer=BLURMATTE,
        round=isinstance(scene.body, Ball) and bool(np.isclose(first, last)) and shot.first is None,
        alpha_std=0.0,
        mean_color=(r, g, b),
    )
    write_picture(picture, files, shot, facts)


def _true_shot(case: Case, camera: Camera) -> TrueShot:
    """The truth behind the lens; of two balls no single paint is true."""

    def seen(layer: Layer) -> Layer:
        alpha, light = map(camera.through_optics, (layer.alpha, layer.premultiplied))
        return Layer(alpha, light)

    truth, scene = case.truth, case.truth.scene
    crossing = len(case.alphas) > 1
    return TrueShot(
        seen(truth.layer),
        LinearImage(camera.through_optics(truth.image.rgb)),
        LinearImage(camera.through_optics(truth.plate.rgb)),
        truth.trajectory,
        max(scene.body.reach(scene.change.at(0))),
        None if crossing else truth.model,
        seen(render(scene).layer) if crossing else None,
    )
