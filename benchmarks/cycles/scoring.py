"""Score methods on pictures with a known truth, in a journal that a later run continues."""

import subprocess
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.accuracy.against_other_methods import Case
from benchmarks.cycles.errors import errors_of
from benchmarks.cycles.methods import OURS, Method, methods
from benchmarks.cycles.outcome import JOURNAL, OUT_OF_TIME, Key, Outcome, append, read_journal
from benchmarks.cycles.pictures import LEARN, TUNE, Facts, Picture, find_pictures
from benchmarks.cycles.workers import Ended, OutOfTime, cpu_limit, run_each, with_progress

import blurmatte
from blurmatte.errors import BlurmatteError, FileError
from blurmatte.layer import Layer
from blurmatte.matting.solution import Solution
from blurmatte.rendering import Ball, Camera, Scene, Shot, colorful_plate, render
from blurmatte.scenes.score import Truth
from blurmatte.trajectory import Trajectory

LIMIT = 60.0  # CPU seconds for a picture
TOLERANCE = 1e-6  # within which two machines agree, absolute or relative, whichever is larger
# What an answer depends on; a commit elsewhere in the package does not ask for new outcomes.
_SOLVING = (
    *("background", "checks.py", "color", "errors.py", "files", "jpeg", "layer.py", "matting"),
    *("radiometry", "statistics", "streaks", "sweep", "trajectory.py"),
)
# Counted |z| can cross a bound by rounding, and seconds are those of the machine.
_NOT_COMPARED = ("cpu_seconds", "limit", "commit", "within_1", "within_2", "counts")
_NOISE = 0.5 / 255
_WARM_UP_CAMERAS = (
    Camera(code_std=_NOISE),
    Camera(code_std=_NOISE, jpeg_quality=90, chroma="4:2:0"),
)


@dataclass(frozen=True)
class Job:
    """A picture that a method is asked for."""

    picture: Picture
    method: str
    limit: float
    commit: str

    @property
    def key(self) -> Key:
        """That of its outcome."""
        p = self.picture
        return Key(p.part, p.scene, p.camera, self.method, self.commit, p.digest)


def score(
    root: Path,
    parts: Sequence[str] = (LEARN, TUNE),
    cameras: Sequence[str] | None = None,
    names: Sequence[str] = (OURS,),
    limit: float = LIMIT,
    processes: int = 2,
) -> Path:
    """Score methods on all pictures that are there and not yet in the journal; show the progress.

    Parameters
    ----------
    root : Path
        Holds pictures/ and the journal.
    parts : sequence of str
    cameras : sequence of str, optional
        All if not given.
    names : sequence of str
        Of `methods.methods()`.
    limit : float
        CPU seconds for a picture; one that is not answered within is an outcome too.
    processes : int

    Returns
    -------
    Path
        The journal.

    Raises
    ------
    ValueError
        If there is no method of such a name, or the journal is damaged.
    """
    known = methods()
    for name in names:
        if name not in known:
            raise ValueError(f"method must be one of {'; '.join(known)}, got {name!r}")
    journal, commit = root / JOURNAL, solving_commit()
    done = {outcome.key for outcome in read_journal(journal)}
    pictures = find_pictures(root, parts, cameras)
    jobs = [Job(picture, name, limit, commit) for picture in pictures for name in names]
    todo = [job for job in jobs if job.key not in done]
    print(f"{len(pictures)} pictures, {len(jobs) - len(todo)} of {len(jobs)} outcomes are there")
    found = _outcomes(todo, processes)
    append(journal, with_progress(found, len(todo), "outcomes", lambda one: one.answered))
    return journal


def check(journal_a: Path, journal_b: Path) -> list[str]:
    """How the numbers of two journals differ, in lines; empty if they agree to `TOLERANCE`.

    Seconds, and counts of pixels that rounding can change, are not compared.
    """
    a, b = ({_place(o.key): o for o in read_journal(path)} for path in (journal_a, journal_b))
    lines = []
    for place in sorted(a.keys() | b.keys()):
        name = ", ".join(place)
        if place not in a or place not in b:
            lines.append(f"{name}: only in {journal_a if place in a else journal_b}")
        elif a[place].key.digest != b[place].key.digest:
            lines.append(f"{name}: the pictures differ")
        else:
            found = _differences("", asdict(a[place]), asdict(b[place]))
            lines += [f"{name}: {difference}" for difference in found]
    return lines


@cache
def solving_commit() -> str:
    """The last commit that changed what solves; "-dirty" if it has changed since.

    Outside a checkout, the version of blurmatte.
    """
    folder = Path(blurmatte.__file__).parent

    def git(*words: str) -> str:
        command = ["git", *words, "--", *(name for name in _SOLVING if (folder / name).exists())]
        return subprocess.run(command, capture_output=True, text=True, cwd=folder).stdout.strip()

    commit = git("log", "-1", "--format=%h", "--abbrev=12")
    if not commit:
        return version("blurmatte")
    return f"{commit}-dirty" if git("status", "--porcelain") else commit


def _place(key: Key) -> tuple[str, str, str, str]:
    return key.part, key.scene, key.camera, key.method


def _outcomes(jobs: Sequence[Job], processes: int) -> Iterator[Outcome]:
    for job, result in run_each(attempt, jobs, processes):
        outcome = _ended(job, result) if isinstance(result, Ended) else result
        if outcome is not None and job.picture.unchanged:
            yield outcome


def _ended(job: Job, end: Ended) -> Outcome | None:
    """The outcome of a process that ended within its job."""
    known = _read(job.picture)
    if known is None:
        return None
    if end.by_limit:
        return _outcome(job, known, None, _out_of_time(job.limit), job.limit)
    return _outcome(job, known, None, f"the process ended with code {end.exit_code}", None)


@dataclass(frozen=True, eq=False)
class _Known:
    """Everything in the files of a picture."""

    case: Case
    truth: Truth
    layers: tuple[Layer, ...]
    facts: Facts


def _read(picture: Picture) -> _Known | None:
    """None if it is rendered again meanwhile: then a later run scores it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            truth = picture.truth()
            case = Case(*picture.read(), truth.layer, picture.model())
            known = _Known(case, truth, picture.answers(truth), picture.facts)
    except (FileError, FileNotFoundError):
        if picture.unchanged:
            raise
        return None
    return known if picture.unchanged else None


def attempt(job: Job) -> Outcome | None:
    """Ask the method for the picture, in the process that this is called in; it may end there.

    None if the picture is not what it was when the job was made.
    """
    known = _read(job.picture)
    if known is None:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _warm_up(job.method)
        start = time.process_time()
        answer, why = _answer(methods()[job.method], known.case, job.limit)
        seconds = time.process_time() - start
    return _outcome(job, known, answer, why, seconds)


def _answer(method: Method, case: Case, limit: float) -> tuple[Solution | Layer | None, str]:
    """The answer, or None and the first sentence of why there is none."""
    begun = time.process_time()
    try:
        with cpu_limit(limit):
            return method.answer(case), ""
    except OutOfTime:
        return None, _out_of_time(limit)
    except (BlurmatteError, ValueError, np.linalg.LinAlgError) as error:
        return None, str(error).split(". ")[0]
    except Exception as error:  # a defect, which is counted and named; the run continues
        if (
            time.process_time() - begun >= limit
        ):  # NumPy answers an interruption by an error of its own
            return None, _out_of_time(limit)
        return None, f"{type(error).__name__}: {error}"


def _out_of_time(limit: float) -> str:
    return f"{OUT_OF_TIME} {limit:g} CPU s"


def _outcome(
    job: Job, known: _Known, answer: Solution | Layer | None, why: str, seconds: float | None
) -> Outcome:
    """Without an answer the empty layer counts."""
    true, facts = known.truth.layer, known.facts
    given = Layer(0 * true.alpha, 0 * true.premultiplied) if answer is None else answer
    return Outcome(
        job.key,
        facts.kind,
        facts.room,
        facts.camera_class,
        facts.renderer,
        answered=answer is not None,
        why=why,
        solver=given.solver if isinstance(given, Solution) else "",
        grade=str(given.stats.grade or "") if isinstance(given, Solution) else "",
        cpu_seconds=seconds,
        limit=job.limit,
        errors=errors_of(given, known.truth, known.layers, facts),
    )


@cache
def _warm_up(name: str) -> None:
    """Import, compile and load what a method needs, so that no timed call does."""
    plate = colorful_plate((72, 56), rng=3, tile=12)
    ball = render(
        Scene(plate, Trajectory.line((22, 22), (48, 34)), Ball(8, np.array([0.9, 0.5, 0.1])))
    )
    for camera in _WARM_UP_CAMERAS:
        image, behind = Shot(ball.scene, camera, seed=5).photograph(ball)
        assert ball.model is not None
        with suppress(BlurmatteError, ValueError):
            methods()[name].answer(Case(image, behind, ball.layer, ball.model))


def _differences(name: str, a: Any, b: Any) -> Iterator[str]:
    """Where two trees of plain values differ."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in a:
            if key not in _NOT_COMPARED:
                yield from _differences(f"{name} {key}".strip(), a[key], b[key])
    elif isinstance(a, tuple | list) and isinstance(b, tuple | list) and len(a) == len(b):
        for n, (x, y) in enumerate(zip(a, b, strict=True)):
            yield from _differences(f"{name} {n}", x, y)
    elif not _alike(a, b):
        yield f"{name}: {a} and {b}"


def _alike(a: Any, b: Any) -> bool:
    if isinstance(a, float | int) and isinstance(b, float | int):
        return abs(a - b) <= TOLERANCE * max(1.0, abs(a), abs(b))
    return bool(a == b)
