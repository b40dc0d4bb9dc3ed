"""What `solve` does with a row of pictures: which are done, the table, and the answer.

All of the library is imported here, and this module only when the command runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import typer

import blurmatte as bm
from blurmatte.cli.console import ExitCode, complain, say, say_json, with_progress
from blurmatte.cli.paths import check_outputs
from blurmatte.cli.quantities import processes
from blurmatte.clips.manifest import NAME, FinishedPicture, Manifest, key_of, opened_manifest
from blurmatte.clips.table import PictureRecord
from blurmatte.files.documents import read_json
from blurmatte.results import RESULT_FILES

TABLE = "pictures.csv"
_MIN_IMAGES_TO_PARALLELIZE = 4  # fewer are solved before other processes have started


# What is printed of one picture, and its row of the table; a record with a reason: refused
Printed = tuple[list[str], PictureRecord]


@dataclass(frozen=True)
class PictureRow:
    """Pictures, each with the folder of its results, and what the results depend on besides.

    Parameters
    ----------
    pairs : list of (Path, Path)
        Picture and folder.
    out : Path
        For the table and the manifest of several pictures.
    files : tuple of Path
        That the options name; their contents are part of the hash by which a run is resumed.
    settings : mapping
        The options.
    """

    pairs: list[tuple[Path, Path]]
    out: Path
    files: tuple[Path, ...]
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        written = [folder / name for _, folder in self.pairs for name in RESULT_FILES]
        of_row = (self.out / TABLE, self.out / NAME) if self.several else ()
        check_outputs(*written, *of_row)

    @property
    def several(self) -> bool:
        """Whether there is more than one picture; one has neither table nor manifest."""
        return len(self.pairs) > 1

    def opened(self) -> AbstractContextManager[Manifest[FinishedPicture]]:
        """The manifest."""
        path = self.out / NAME if self.several else None
        return opened_manifest(path, key_of(self.files, self.settings), FinishedPicture)

    def done(self, manifest: Manifest[FinishedPicture]) -> dict[Path, PictureRecord]:
        """The pictures that were solved before and whose results are all there."""
        known = {one.key: one.record for one in manifest.finished}
        return {
            path: replace(known[_key(path)], picture=_text(path), folder=_text(folder.name))
            for path, folder in self.pairs
            if known and _key(path) in known and all((folder / n).exists() for n in RESULT_FILES)
        }


def solve_row(
    row: PictureRow,
    work: Callable[[Path, Path], Printed],
    required: bm.Grade | None,
    workers: int | None,
    as_json: bool,
) -> None:
    """Solve the pictures that are not done, each into its folder, and say what came of all."""
    records: list[PictureRecord] = []
    lower = 0
    with row.opened() as manifest:
        done = row.done(manifest)
        rest = [pair for pair in row.pairs if pair[0] not in done]
        count = processes(workers, len(rest), _MIN_IMAGES_TO_PARALLELIZE)
        with bm.motion.Workers(count) as pool:
            solved = pool.in_order(work, rest)
            for path, folder in with_progress(row.pairs, "solving"):
                lines, record = ([], done[path]) if path in done else next(solved)
                records.append(record)
                if record.reason:
                    complain(record.reason)
                    continue
                if path not in done and row.several:
                    manifest.append(FinishedPicture(_key(path), record))
                if as_json:
                    hint = "remove the file, and solve its picture again"
                    report = read_json(folder / "report.json", dict[str, Any], hint, "report")
                    say_json({"folder": folder, **report}, indent=None if row.several else 2)
                elif lines:
                    say("\n".join(lines))
                lower += _is_lower(path, record.grade, required)
    if row.several:
        bm.write(row.out / TABLE, [record.numbers() for record in records])
    refused = sum(bool(record.reason) for record in records)
    if row.several and not as_json:
        say(_summary(len(records), len(done), refused))
        say(str(row.out / TABLE))
    if refused or lower:
        raise typer.Exit(ExitCode.REFUSED if refused else ExitCode.LOW_GRADE)


def refusal(path: Path, error: bm.BlurmatteError) -> Printed:
    """The answer of a picture that cannot be solved."""
    return [], PictureRecord(_text(path), reason=_text(error))


def solved_picture(path: Path, folder: Path, solution: bm.Solution) -> PictureRecord:
    """The row of a picture that is solved, and whose results are written."""
    record = PictureRecord.of(solution)
    return replace(record, picture=_text(path), folder=_text(folder.name))


def _summary(count: int, done: int, refused: int) -> str:
    """How many pictures were solved now and before, and refused."""
    parts = [f"{count - done - refused} solved now"]
    parts += [f"{done} done before"] if done else []
    parts += [f"{refused} refused"] if refused else []
    return f"{count} pictures: {', '.join(parts)}"


def _key(path: Path) -> str:
    """Hash of the content of a picture; "" if it is no file."""
    return key_of([path], {}) if path.is_file() else ""


def _text(name: object) -> str:
    """A file name or message as text, whatever bytes it holds."""
    return str(name).encode("utf-8", "backslashreplace").decode()


def _is_lower(path: Path, found: str, required: bm.Grade | None) -> bool:
    """True if a solution has a lower grade than required, or none; prints an error then."""
    if required is None or (found and bm.Grade(found) >= required):
        return False
    grade = f"its grade is {found}" if found else "it has no grade"
    complain(f"{path}: {grade}, --require asks for {required}; its files were written")
    return True
