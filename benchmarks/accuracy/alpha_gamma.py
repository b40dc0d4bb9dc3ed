"""How large is the error of alpha if pictures are decoded with the wrong curve?

Run: python -m benchmarks.accuracy.alpha_gamma
"""

from dataclasses import replace

import numpy as np
from benchmarks.table import Cell, Table, publish_all
from benchmarks.trials import (
    CODE,
    COLUMNS,
    KINDS,
    MEANING,
    ORANGE,
    SCENE,
    SEEDS,
    Attempt,
    alpha_rows,
    attempt,
    rendering,
)

from blurmatte.color.model import ColorModel
from blurmatte.radiometry import LinearImage, decode, named_transfer
from blurmatte.rendering import Camera

GAMMAS = (1.8, 2.0, 2.2, 2.4, 2.6)
PLATE_FRAMES = 5


def picture(light: np.ndarray, coded: str, decoded: str, rng: np.random.Generator) -> LinearImage:
    """Eight bits, coded with one curve and decoded with another."""
    camera = Camera(code_std=CODE, transfer=named_transfer(coded))
    return decode(camera.expose(light, rng), named_transfer(decoded))


def trial(kind: str, coded: str, decoded: str, gamma: float | None, seed: int) -> Attempt:
    truth, rng = rendering(kind, seed), np.random.default_rng(seed)
    image = picture(truth.image.rgb, coded, decoded, rng)
    frames = [picture(truth.plate.rgb, coded, decoded, rng) for _ in range(PLATE_FRAMES)]
    plate = replace(frames[0], rgb=np.median([frame.rgb for frame in frames], axis=0))
    codes = named_transfer(coded).encode(ORANGE)  # what a color picker shows of the sharp ball
    model = ColorModel.from_samples(named_transfer(decoded).decode(codes), std=0)
    return attempt(image, plate, model, truth)


def pairs() -> list[tuple[Cell, ...]]:
    """Names of both curves, and the exponent of the first."""
    curves = [("srgb", "srgb", None), ("rec709", "srgb", None), ("srgb", "rec709", None)]
    return curves + [(f"gamma{g:g}", "srgb", g) for g in GAMMAS]


def tables(quick: bool = False) -> list[Table]:
    settings = [(kind, *pair) for kind in KINDS for pair in pairs()]
    rows = alpha_rows(trial, settings[::20] if quick else settings, quick)
    return [
        Table(
            "alpha_gamma",
            "How large is the error of alpha if pictures are decoded with the wrong curve?",
            f"{SCENE} 8 bits, coded with one curve, decoded with another, with noise of 1 code value "
            "of 255. The given line is the color of the sharp ball, decoded with the same "
            f"wrong curve. {MEANING.format(seeds=SEEDS)}",
            ("plate", "coded", "decoded", "gamma", *COLUMNS),
            rows,
            x="gamma",
            lines="plate",
            y="sum bias",
        )
    ]


if __name__ == "__main__":
    publish_all(tables)
