"""Outcome: what a method made of a picture, and the journal that keeps outcomes.

A journal is a file of JSON lines that only grows. A line that was cut off, when a run was killed
while it wrote, is dropped by the next run.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.cycles.errors import Errors

JOURNAL = "journal.jsonl"
OUT_OF_TIME = "no answer within"  # how `Outcome.why` begins then


@dataclass(frozen=True)
class Key:
    """What an outcome depends on: it is not asked for twice.

    Parameters
    ----------
    part, scene, camera : str
        Of the picture.
    method : str
    commit : str
        The last one that changed what solves in blurmatte.
    digest : str
        Of the picture's files.
    """

    part: str
    scene: str
    camera: str
    method: str
    commit: str
    digest: str


@dataclass(frozen=True)
class Outcome:
    """What a method made of a picture.

    Parameters
    ----------
    key : Key
    kind, room, camera_class, renderer : str
        Of the picture; see `pictures.Facts`.
    answered : bool
    why : str
        The first sentence of the rejection, or that the limit was reached; empty if answered.
    solver : str
        The one that the solution names; empty without a solution.
    cpu_seconds : float or None
        Of all threads of the worker process during the call; None if the process crashed.
    limit : float
        CPU seconds that were allowed.
    errors : Errors
        Of the answer, or of the empty layer if there is none.
    grade : str
        Of the solution; empty without one.
    """

    key: Key
    kind: str
    room: str
    camera_class: str
    renderer: str
    answered: bool
    why: str
    solver: str
    cpu_seconds: float | None
    limit: float
    errors: Errors
    grade: str = ""

    @property
    def out_of_time(self) -> bool:
        """Whether the limit was reached."""
        return self.why.startswith(OUT_OF_TIME)

    def to_json(self) -> str:
        """One line."""
        return json.dumps(asdict(self), allow_nan=False)

    @classmethod
    def from_json(cls, line: str) -> "Outcome":
        """The inverse.

        Raises
        ------
        ValueError
            If the line holds no outcome.
        """
        try:
            fields: dict[str, Any] = json.loads(line)
            key, errors = Key(**fields.pop("key")), Errors.from_json(fields.pop("errors"))
            return cls(key=key, errors=errors, **fields)
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(f"no outcome ({error!r}) in {line[:80]!r}") from error


def read_journal(path: Path) -> list[Outcome]:
    """All outcomes of a journal, of several with one key the last; none if there is no file.

    Raises
    ------
    ValueError
        If a line other than an unfinished last one holds no outcome.
    """
    if not path.exists():
        return []
    whole, _, _ = path.read_text(encoding="utf-8").rpartition("\n")
    outcomes = map(Outcome.from_json, filter(None, whole.split("\n")))
    return list({outcome.key: outcome for outcome in outcomes}.values())


def append(path: Path, outcomes: Iterable[Outcome]) -> None:
    """Add outcomes to a journal, each flushed as it comes; an unfinished last line is cut off."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "a+b") as file:
        file.seek(0)
        file.truncate(file.read().rfind(b"\n") + 1)
        for outcome in outcomes:
            file.write(outcome.to_json().encode() + b"\n")
            file.flush()
