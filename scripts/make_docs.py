"""Draw docs/overview.png, and write the tables of docs/benchmark.md from docs/results.

The picture is the sheet that `blurmatte solve` makes of examples/colorful, smaller.
Run it from anywhere: python scripts/make_docs.py
"""

import csv
import re
from pathlib import Path

import numpy as np
from PIL import Image

import blurmatte as bm

ROOT = Path(__file__).parent.parent
WIDTH = 900
BENCHMARK = ROOT / "docs" / "benchmark.md"
SCENES = {
    "method": "method",
    "given": "given",
    "alpha": "RMSE, median",
    "alpha worst": "worst",
    "bias": "bias, median",
    "light": "light RMSE",
    "seconds": "seconds",
}
CYCLES = {
    "files": "files",
    "method": "method",
    "given": "given",
    "answered": "answered",
    "RMSE": "RMSE, median",
    "RMSE 90 %": "90 %",
    "bias %": "bias, %",
    "CPU s": "CPU s",
    "nearer than blurmatte": "nearer",
    "of": "of",
}


def reduced(sheet: np.ndarray) -> np.ndarray:
    """(H, 900, 3) uint8 of an sRGB-coded sheet; light is averaged, not code values."""
    height, width = sheet.shape[:2]
    smaller = bm.compositing.cover(
        bm.decode(sheet, bm.SRGB), (WIDTH, round(height * WIDTH / width))
    )
    return np.rint(255 * bm.SRGB.encode(np.clip(smaller.rgb, 0, 1))).astype(np.uint8)


def rows(name: str) -> list[dict[str, str]]:
    """Rows of a table of docs/results."""
    text = (ROOT / "docs" / "results" / f"{name}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def table(found: list[dict[str, str]], columns: dict[str, str]) -> str:
    """Some columns in Markdown."""
    lines = [columns.values(), ("---:" if n > 1 else "---" for n in range(len(columns)))]
    lines += [[row[column] for column in columns] for row in found]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def benchmark_tables() -> str:
    """Both tables of docs/benchmark.md, the most accurate method first."""
    scenes = sorted(rows("against_other_methods"), key=lambda row: float(row["alpha"]))
    cycles = [row for row in rows("second_truth_methods") if row["renderer"] == "cycles"]
    cycles.sort(key=lambda row: (row["files"] == "phone", float(row["RMSE"])))
    return (
        f"\n## Scenes of the package\n\n{table(scenes, SCENES)}\n\n"
        "`key`: the difference to the plate as alpha; `published`: the equations of 2007; `cv`: "
        "OpenCV's background subtractors; `pm`: PyMatting, with a trimap made from the truth; "
        "`empty`: alpha 0.\n\n"
        f"## Scenes of Blender Cycles\n\n{table(cycles, CYCLES)}\n\n"
        "`first disc`: the best disc of one paint of blurmatte's search; `smooth`: smooth alpha "
        "with its color.\n\n"
    )


def with_tables(text: str) -> str:
    """The text of docs/benchmark.md with its tables as they are in docs/results."""
    parts = re.split(r"(<!-- (?:tables: .*|end of tables) -->)", text)
    return "".join([*parts[:2], benchmark_tables(), *parts[3:]])


def main() -> None:
    """Solve, draw, reduce, write."""
    BENCHMARK.write_text(with_tables(BENCHMARK.read_text(encoding="utf-8")), encoding="utf-8")
    image, plate = (bm.read(ROOT / f"examples/colorful/{name}.png") for name in ("image", "plate"))
    sheet = bm.figures.draw_overview(image, plate, bm.solve(image, plate))
    Image.fromarray(reduced(sheet)).save(ROOT / "docs" / "overview.png", optimize=True)


if __name__ == "__main__":
    main()
