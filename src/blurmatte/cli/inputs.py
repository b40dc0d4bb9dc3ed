"""Which files are meant, and how they are read."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from glob import glob
from pathlib import Path

import blurmatte as bm
from blurmatte.cli.program import about


@dataclass(frozen=True)
class Files:
    """How picture files are read."""

    transfer: str | None
    max_pixels: int
    noise: bm.NoiseModel | None = None

    @property
    def curve(self) -> bm.Transfer | None:
        """The transfer curve that was asked for; None: what the file says."""
        if self.transfer is None:
            return None
        if self.transfer.lower().endswith(".json"):
            return bm.read_transfer(self.transfer)
        return bm.named_transfer(self.transfer)

    def read(self, path: Path, said: list[str] | None = None) -> tuple[bm.LinearImage, list[str]]:
        """The picture, and what there was to warn of (also added to `said`)."""
        with about(path) as notes:
            picture = bm.read(path, self.curve, self.max_pixels)
        if self.noise is not None and picture.noise is None:
            picture = picture.with_noise(self.noise)
        if said is not None:
            said += notes
        return picture, notes


def places(images: Iterable[str], out: Path) -> list[tuple[Path, Path]]:
    """Each image and the folder for its results: `out` itself if there is but one."""
    paths = [path for text in images for path in expanded(text)]
    if len(paths) == 1:
        return [(paths[0], out)]
    stems = [path.stem for path in paths]
    for stem in stems:
        if stems.count(stem) > 1:
            raise ValueError(f"{stems.count(stem)} images are called {stem}; solve them apart")
    return [(path, out / path.stem) for path in paths]


def expanded(text: str) -> list[Path]:
    """The file of this name, or all that a pattern finds."""
    if Path(text).exists() or not re.search(r"[*?\[]", text):
        return [Path(text)]
    found = sorted(glob(text, recursive=True))
    if not found:
        raise bm.FileError(f"{text}: there are no such files; check the pattern")
    return [Path(path) for path in found]


def numbers(name: str, text: str, *counts: int) -> list[float]:
    """Numbers with commas between them, as many as one of `counts`."""
    parts = text.split(",")
    whole = r"\s*-?\d+\s*" if 4 in counts else r"\s*-?\d+(\.\d*)?\s*"
    if len(parts) not in counts or not all(re.fullmatch(whole, part) for part in parts):
        what = "x0,y0,x1,y1 in whole pixels" if 4 in counts else "x,y or x,y,radius"
        raise ValueError(f"{name} must be {what}, got {text!r}")
    return [float(part) for part in parts]
