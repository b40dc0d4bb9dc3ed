"""Layer files of a clip: one for each frame, written by the process that solves it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from blurmatte.clips.table import FrameRecord
from blurmatte.files import read_layer, write, write_frames
from blurmatte.formats import Writes, written
from blurmatte.layer import Layer
from blurmatte.motion.clip.solving import FrameSolver, Wanted
from blurmatte.radiometry import LinearImage

LAYER_EXTENSIONS = written(Writes.LAYER)


@dataclass(frozen=True, eq=False)
class LayerWriter:
    """Solves a frame and writes its layer; runs in any process.

    Parameters
    ----------
    solver : FrameSolver
    folder : Path
        Of the results.
    shot : int
        Number of the shot.
    extension : str
        .exr, .png or .tif.
    several : bool
        Each object has a folder of its own.
    complete : bool
        Write all numbers of the solution, its sweep included.
    """

    solver: FrameSolver
    folder: Path
    shot: int
    extension: str
    several: bool
    complete: bool = False

    def __call__(self, frames: Sequence[LinearImage], wanted: Wanted) -> FrameRecord:
        """Solve a frame, given alone, write its layer, and return its record."""
        row = wanted.row
        solution = self.solver(frames, wanted)
        if isinstance(solution, str):
            return FrameRecord(row.frame, row.time, row.object or 1, self.shot, reason=solution)
        name = layer_name(row.frame, row.object or 1, self.extension, self.several)
        write(self.folder / name, solution if self.complete else solution.layer)
        return FrameRecord.of(row, self.shot, solution, name)


def layer_name(frame: int, number: int, extension: str, several: bool) -> str:
    """Name of the layer of an object in a frame, in the folder of results."""
    name = f"layer.{frame:06d}{extension}"
    return f"object{number}/{name}" if several else name


def write_movie(
    path: Path,
    folder: Path,
    records: Sequence[FrameRecord],
    frames: Sequence[int],
    rate: float | None,
) -> None:
    """Write the layers of one object as a ProRes 4444 with alpha, as long as the clip."""
    named = {record.frame: record for record in records if record.layer}
    first = read_layer(folder / next(iter(named.values())).layer)
    empty = Layer(np.zeros_like(first.alpha), np.zeros_like(first.premultiplied))

    def layers() -> Iterator[Layer]:
        for number in frames:
            record = named.get(number)
            yield empty if record is None else read_layer(folder / record.layer)

    write_frames(path, layers(), rate=rate)
