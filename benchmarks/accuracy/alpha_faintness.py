"""How faint may a streak be?

Run: python -m benchmarks.accuracy.alpha_faintness
"""

from benchmarks.table import Table, publish_all
from benchmarks.trials import (
    CODE,
    COLUMNS,
    KINDS,
    LENGTH,
    MEANING,
    RADIUS,
    SCENE,
    Attempt,
    alpha_rows,
    attempt,
    photograph,
    rendering,
)

from blurmatte.rendering import Camera

PEAKS = (0.5, 0.25, 0.15, 0.1, 0.06, 0.03)
SEEDS = 3


def trial(kind: str, color: str, peak: float, seed: int) -> Attempt:
    truth = rendering(kind, seed, opacity=peak / (2 * RADIUS / LENGTH))
    image, plate = photograph(truth, Camera(code_std=CODE), seed)
    return attempt(image, plate, truth.model if color == "given" else None, truth)


def tables(quick: bool = False) -> list[Table]:
    settings = [(k, color, p) for k in KINDS for color in ("given", "found") for p in PEAKS]
    settings = [s for s in settings if s[:2] != ("plain", "found")]
    rows = alpha_rows(trial, settings[::29] if quick else settings, quick, SEEDS)
    return [
        Table(
            "alpha_faintness",
            "How faint may a streak be?",
            f"{SCENE} It is made ever more transparent, until the largest alpha is that of the row. "
            "8 bits with noise of 1 code value of 255; the true line is given, or found in the streak "
            f"(before a plain plate it cannot be). {MEANING.format(seeds=SEEDS)}",
            ("plate", "color", "peak alpha", *COLUMNS),
            rows,
            x="peak alpha",
            lines="color",
            y="sum bias",
            panels="plate",
            log_x=True,
        )
    ]


if __name__ == "__main__":
    publish_all(tables)
