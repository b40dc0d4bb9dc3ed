"""How does the error of alpha grow with noise?

Run: python -m benchmarks.accuracy.alpha_noise
"""

from benchmarks.table import Table, publish_all
from benchmarks.trials import (
    CODE,
    COLUMNS,
    KINDS,
    MEANING,
    SCENE,
    Attempt,
    alpha_rows,
    attempt,
    photograph,
    rendering,
)

from blurmatte.rendering import Camera

NOISES = (0.25, 0.5, 1, 2, 4)
DEPTHS = {"8 bits": 8, "float": None}
SEEDS = 3


def trial(kind: str, noise: float, depth: str, color: str, seed: int) -> Attempt:
    truth = rendering(kind, seed)
    camera = Camera(code_std=noise * CODE, bits=DEPTHS[depth])
    image, plate = photograph(truth, camera, seed)
    return attempt(image, plate, truth.model if color == "given" else None, truth)


def tables(quick: bool = False) -> list[Table]:
    inputs = [("8 bits", "given"), ("float", "given"), ("8 bits", "found")]
    settings = [(kind, noise, *one) for kind in KINDS for one in inputs for noise in NOISES]
    rows = alpha_rows(trial, settings[::14][:2] if quick else settings, quick, SEEDS)
    return [
        Table(
            "alpha_noise",
            "How does the error of alpha grow with noise?",
            f"{SCENE} noise: standard deviation in sRGB code values of 255, of floats and of 8 bits, "
            "which adds rounding (0.29). color: the true line is given, or nothing is. "
            f"{MEANING.format(seeds=SEEDS)}",
            ("plate", "noise", "depth", "color", *COLUMNS),
            rows,
            x="noise",
            x_unit="code values of 255",
            lines=("color", "depth"),
            y="alpha RMSE",
            log=True,
            panels="plate",
            log_x=True,
        )
    ]


if __name__ == "__main__":
    publish_all(tables)
