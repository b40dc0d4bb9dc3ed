"""How does the error of alpha depend on JPEG quality?

Run: python -m benchmarks.accuracy.alpha_jpeg
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

QUALITIES = (75, 85, 95, 100)
CHROMAS = ("4:4:4", "4:2:0")
SEEDS = 3


def trial(kind: str, chroma: str, quality: int | None, color: str, seed: int) -> Attempt:
    truth = rendering(kind, seed)
    camera = Camera(code_std=CODE, jpeg_quality=quality, chroma=chroma)
    image, plate = photograph(truth, camera, seed)
    return attempt(image, plate, truth.model if color == "given" else None, truth)


def tables(quick: bool = False) -> list[Table]:
    files = [("4:4:4", None), *((chroma, quality) for chroma in CHROMAS for quality in QUALITIES)]
    settings = [
        (kind, *file, color) for kind in KINDS for color in ("given", "found") for file in files
    ]
    rows = alpha_rows(trial, settings[:10:9] if quick else settings, quick, SEEDS)
    return [
        Table(
            "alpha_jpeg",
            "How does the error of alpha depend on JPEG quality?",
            f"{SCENE} Image and every frame of the plate are JPEG files of a quality, or PNG (-), "
            "after noise of 1 code value of 255. chroma 4:2:0: two by two pixels share a color. "
            "color: the true line is given, or nothing is. "
            f"{MEANING.format(seeds=SEEDS)}",
            ("plate", "chroma", "quality", "color", *COLUMNS),
            rows,
            x="quality",
            lines=("chroma", "color"),
            y="alpha RMSE",
            log=True,
            panels="plate",
        )
    ]


if __name__ == "__main__":
    publish_all(tables)
