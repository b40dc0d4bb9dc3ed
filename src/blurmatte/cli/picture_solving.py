"""One picture solved, for the commands that need its solution."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import blurmatte as bm
from blurmatte.cli.console import about, warn
from blurmatte.cli.selection import GUESSED, CameraReading, ObjectColor, Selection


@dataclass(frozen=True, eq=False)
class MatchedPlate:
    """An image and the plate at its moment; the image has the noise of a guess."""

    image: bm.LinearImage
    plate: bm.LinearImage
    taken: list[tuple[bm.background.Match, bm.LinearImage]]  # not for a guess

    @property
    def match(self) -> bm.background.Match:
        """The one that moves a plate farthest."""
        nothing = bm.background.Match.nothing(self.image.size)
        return max((match for match, _ in self.taken), key=lambda one: one.reach, default=nothing)

    def parallax(self, solution: bm.Solution) -> list[bm.background.ParallaxRegion]:
        """Where the camera moved in space, outside of the streak."""
        if not self.match.moves:
            return []
        alone = len(self.taken) == 1
        plates = [self.plate] if alone else [match.apply(plate) for match, plate in self.taken]
        return bm.background.parallax_between(self.image, *plates, ignored=solution.streak)


@dataclass(frozen=True, eq=False)
class PictureOptions:
    """Options that apply to all images."""

    plates: list[bm.LinearImage]  # none: it is guessed from the surroundings of the region
    notes: list[str]  # warnings of reading the plate
    selection: Selection
    occluder: Path | None
    solver: bm.matting.Solver | None
    matching: bm.background.Matching | None  # of plates that were taken

    def with_plate(self, image: bm.LinearImage) -> MatchedPlate:
        """The plate of an image."""
        if not self.plates:
            region = self.selection.inside(image.size)
            assert region is not None
            guess = bm.background.guess_plate(image, region.mask)
            image = image if image.noise is not None else image.with_noise(guess.image_noise)
            return MatchedPlate(image, guess, [])
        if len(self.plates) > 1:
            plate, matches = bm.background.burst_plate(image, self.plates, self.matching)
        else:
            matches = [bm.background.fit_match(image, self.plates[0], self.matching)]
            plate = matches[0].apply(self.plates[0])
        return MatchedPlate(image, plate, list(zip(matches, self.plates, strict=True)))


def solved_picture_at(
    path: Path,
    plate: Path,
    region: str | None,
    reading: CameraReading,
    opacity: bm.sweep.OpacityPrior,
) -> bm.Solution:
    """The solution of one picture, for commands that write no layer; warns of its doubts."""
    if plate == GUESSED:
        check_guess("auto", region, is_shaded=False, transfer=reading.transfer)
    notes: list[str] = []
    plates = [] if plate == GUESSED else [reading.read(plate, notes)]
    selection = Selection(reading, ObjectColor(), region)
    solver = bm.matting.Averaged(opacity=opacity)
    task = PictureOptions(plates, notes, selection, None, solver, None)
    with about(path) as said:
        return solved(task, path, said)[-1]


def solved(task: PictureOptions, path: Path, said: list[str]) -> tuple[MatchedPlate, bm.Solution]:
    """One image with its matched plate, and the solution, whose doubts are added to said."""
    from blurmatte.explain.solution import bent_light, doubts, second_hue

    logging.getLogger("blurmatte").info("reading the picture")
    reading = task.selection.reading
    C = reading.read(path, said)
    pictures = task.with_plate(C)
    C, matched, match = pictures.image, pictures.plate, pictures.match
    streak = task.selection.streak(C, matched)
    hidden = None if task.occluder is None else task.selection.hidden(task.occluder, C.size)
    with naming_streaks(streak, C, matched):
        solution = bm.solve(
            C,
            matched,
            task.selection.model(C, matched, streak),
            None if task.solver is None else task.solver.matched(match),
            streak=streak,
            matching=bm.background.Matching.NONE,
            occluder=hidden,
        )
    solution = replace(solution, stats=solution.stats.with_match(match))
    found = doubts(solution)
    if reading.transfer is None:
        fit = bm.sweep.transfer_fit.fit_of_doubted_curve(
            C, matched, solution.streak, solution.sweep
        )
        found += [] if fit is None else [bent_light(fit.curves[0], fit.best)]
    if _has_one_hue(solution) and not matched.is_guess:
        part = bm.color.streak.residual_of_second_hue(
            C, matched, bm.streaks.Streak(solution.streak), solution.model
        )
        found += [] if part is None else [second_hue(part)]
    for doubt in found:
        said.append(f"{path}: {doubt.rstrip('.')}")
        warn(said[-1])
    return pictures, solution


def _has_one_hue(solution: bm.Solution) -> bool:
    """Whether alpha follows from one hue."""
    stats = solution.stats
    return solution.model.rank == 1 and not (stats.is_gray or stats.only_adds_light)


def check_guess(match: str, region: str | None, is_shaded: bool, transfer: str | None) -> None:
    """Raise ValueError for options that a guess of the plate contradicts."""
    if region is None:
        raise ValueError(
            "--plate none needs --region, where the object may have been: what is behind it is guessed "
            "from the scene around that; find IMAGE --plate none proposes regions"
        )
    if match not in ("auto", "none"):
        raise ValueError(f"--match {match} needs a plate; with --plate none leave it out")
    if is_shaded:
        raise ValueError("--solver shaded needs a plate: a guess does not show what is a shadow")
    if transfer == "auto":
        raise ValueError(
            "--transfer auto compares image and plate; with --plate none name the curve"
        )


@contextmanager
def naming_streaks(
    streak: bm.streaks.Streak | None, image: bm.LinearImage, plate: bm.LinearImage
) -> Iterator[None]:
    """Add the streaks that were found to an error, unless a region was given."""
    try:
        yield
    except (bm.errors.ColorModelError, bm.errors.MotionError) as error:
        from blurmatte.explain.solution import also_moved, as_region

        found = [] if streak is not None else bm.find_streaks(image, plate)
        if not found:
            raise
        first, *others = found
        boxes = [other.box for other in others if other.significant]
        more = "".join(f"; {line}" for line in also_moved(boxes, len(others) - len(boxes)))
        where = f"The strongest is the streak in {as_region(first.box)} (X0,Y0,X1,Y1){more}"
        raise type(error)(f"{error}. {where}") from error
