"""Which files are meant, and how they are read."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from glob import glob
from pathlib import Path

import blurmatte as bm
from blurmatte.cli.program import about

_PICTURES = ".exr", ".png", ".tif", ".tiff", ".jpg", ".jpeg"
_NUMBER = r"\s*[-+]?(\d+\.?\d*|\.\d+)\s*"


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

    def curve_of(self, path: Path | str) -> bm.Transfer | None:
        """The curve of one file: that which was asked for, but an EXR holds light, not code values."""
        return None if str(path).lower().endswith(".exr") else self.curve

    def read(self, path: Path, said: list[str] | None = None) -> tuple[bm.LinearImage, list[str]]:
        """The picture, and what there was to warn of (also added to `said`)."""
        with about(path) as notes:
            picture = bm.read(path, self.curve_of(path), self.max_pixels)
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


def is_row(source: Path) -> bool:
    """Whether a clip or a row of files is meant, and not one picture or layer."""
    marked = re.search(r"[#*?\[]|%\d*d", source.name) is not None
    several = source.is_dir() or (marked and not source.is_file())
    return several or source.suffix.lower() not in _PICTURES


def numbers(name: str, text: str, *forms: str) -> list[float]:
    """Numbers with commas between them, as many as one of `forms` has, like "x,y,radius"."""
    parts = text.split(",")
    counts = [form.count(",") + 1 for form in forms]
    if len(parts) not in counts or not all(re.fullmatch(_NUMBER, part) for part in parts):
        raise ValueError(f"{name} must be {' or '.join(forms)}, got {text!r}")
    return [float(part) for part in parts]


def box_of(text: str) -> tuple[int, int, int, int]:
    """The box that --region gives."""
    if not re.fullmatch(r"(\s*-?\d+\s*,){3}\s*-?\d+\s*", text):
        raise ValueError(f"--region must be x0,y0,x1,y1 in whole pixels, got {text!r}")
    x0, y0, x1, y1 = (int(part) for part in text.split(","))
    return x0, y0, x1, y1


def matching_of(name: str) -> bm.Matching | None:
    """The matching of a name; None: what suits."""
    names = ["auto", *(way.value for way in bm.Matching)]
    if name not in names:
        raise ValueError(f"--match must be {', '.join(names[:-1])} or {names[-1]}, got {name!r}")
    return None if name == "auto" else bm.Matching(name)
