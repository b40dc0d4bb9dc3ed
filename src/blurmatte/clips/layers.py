"""Layer files of a clip: one for each frame, written by the process that solves it."""

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile

from blurmatte.clips.table import FrameRecord
from blurmatte.files.atomic import replacing
from blurmatte.files.frames import write_frames
from blurmatte.files.reading import read_layer
from blurmatte.files.writing import write
from blurmatte.formats import Writes, written
from blurmatte.layer import Layer, empty_layer
from blurmatte.motion.clip.solving import FrameSolver, FrameToSolve
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

    def __call__(self, frames: Sequence[LinearImage], wanted: FrameToSolve) -> FrameRecord:
        """Solve a frame, given alone, write its layer, and return its record."""
        row, (frame, number) = wanted.row, wanted.row.place
        solution = self.solver(frames, wanted)
        if isinstance(solution, str):
            return FrameRecord(frame, row.time, number, self.shot, reason=solution)
        name = layer_name(frame, number, self.extension, self.several)
        if self.several:
            (self.folder / name).parent.mkdir(exist_ok=True)
        write(self.folder / name, solution if self.complete else solution.layer)
        return FrameRecord.of(row, self.shot, solution, name)


def layer_name(frame: int, number: int, extension: str, several: bool) -> str:
    """Name of the layer of an object in a frame, in the folder of results."""
    name = f"layer.{frame:06d}{extension}"
    return f"object{number}/{name}" if several else name


def write_empty_layers(
    folder: Path,
    records: Sequence[FrameRecord],
    frames: Sequence[int],
    size: tuple[int, int],
    extension: str,
    several: bool,
) -> list[list[str]]:
    """Write a transparent layer for each frame without one, so that no number is missing.

    For each object that has a layer in some frame. Returns the names of the files of each object.
    """
    written = list[list[str]]()
    for number in sorted({record.object for record in records if record.layer}):
        named = {record.frame for record in records if record.layer and record.object == number}
        rest = [frame for frame in frames if frame not in named]
        written.append([layer_name(frame, number, extension, several) for frame in rest])
        paths = [folder / name for name in written[-1]]
        for path in paths[:1]:
            write(path, empty_layer(size))
        for path in paths[1:]:  # a copy takes much less time than to compress it again
            with replacing(path, extension) as temporary:
                copyfile(paths[0], temporary)
    return written


def remove_layers(
    folder: Path, names: Iterable[str], frames: Collection[int], extension: str, several: bool
) -> None:
    """Remove those of the files that a layer of these frames would have as its name."""
    form = re.compile(rf"{'object[0-9]+/' if several else ''}layer\.([0-9]+){re.escape(extension)}")
    for name in names:
        found = form.fullmatch(name)
        if found is not None and int(found[1]) in frames:
            (folder / name).unlink(missing_ok=True)


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
    empty = empty_layer(first.size)

    def layers() -> Iterator[Layer]:
        """The layer of each frame."""
        for number in frames:
            record = named.get(number)
            yield empty if record is None else read_layer(folder / record.layer)

    write_frames(path, layers(), rate=rate)
