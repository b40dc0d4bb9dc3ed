"""What `track` does when it runs; all of the library is imported here, and this module only then."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import blurmatte as bm
from blurmatte.cli.console import WITHOUT_HUE, about, answer, complain, in_degrees, waiting, warn
from blurmatte.cli.quantities import Direction, processes
from blurmatte.clips.manifest import Finished, key_of, opened_manifest
from blurmatte.explain.calibration import camera_in_words
from blurmatte.explain.clip import clip_in_words, summary_in_words
from blurmatte.motion.clip.balls import balls_in_space
from blurmatte.motion.clip.cadence import Cadence
from blurmatte.motion.clip.detections import FrameSightings
from blurmatte.motion.clip.measure import explaining_curve, radius_spread
from blurmatte.motion.clip.steps import ClipInputs, ClipMeasured, measured
from blurmatte.motion.clip.summary import (
    KnownQuantities,
    ObjectSummary,
    Places,
    clip_table,
    summaries,
)
from blurmatte.motion.clip.workers import return_freed_memory
from blurmatte.motion.picture.motion import MAX_READOUT

_MOVING = (
    "--camera needs a camera at rest, and this one moves: give a part of the clip in which it stands "
    "still (--frames), or leave --camera out"
)
_MIN_FRAMES_TO_PARALLELIZE = 16  # below, starting processes takes longer than they save


@dataclass(frozen=True, eq=False)
class Tracking:
    """What is measured in a clip, and where the table and the frames that are finished are kept."""

    source: Path  # for messages
    frames: bm.Frames[bm.LinearImage]
    clip: ClipInputs
    known: KnownQuantities
    readout: Direction | None  # where the next row of the sensor lies; None: as the file says
    out: Path | None
    unfinished: Path | None

    def measured(
        self, wanted: int | None, files: tuple[Path, ...], settings: dict[str, Any]
    ) -> tuple[ClipMeasured, Places | None, KnownQuantities]:
        """The object in each frame and in space, and all that is known then."""
        frames, known = self.frames, self.known
        count = processes(wanted, len(frames), _MIN_FRAMES_TO_PARALLELIZE)
        return_freed_memory()
        # Processes start while the plate is made.
        with (
            self._recorded(files, settings) as (old, record),
            about(self.source),
            bm.motion.Workers(count) as workers,
            waiting("reading the clip"),
        ):
            frames = frames.for_plate(self.clip.plate)
            for event in measured(replace(self.clip, frames=frames, finished=old), workers):
                if isinstance(event, FrameSightings):
                    record(event)
                else:
                    found = event if self.readout is None else event.read_out(self.readout)
            if found.camera is not None and known.lens is not None:
                raise bm.errors.MotionError(_MOVING)
            places = balls_in_space(known, frames, found.plate, found.rows, found.color, workers)
        if frames.curve_assumed and known.radius is not None:
            with waiting("comparing transfer curves"):
                numbers, rows = frames.frame_numbers, found.in_frames
                spread = radius_spread(frames, found.plate, rows, numbers, found.camera)
                known = replace(known, radius_std=spread)
        if frames.curve_assumed:
            self._compare_curves(found)
        return found, places, replace(known, place_std=frames.place_std)

    def _compare_curves(self, found: ClipMeasured) -> None:
        """Warn if frames without a disc have one with another curve than the one that was assumed."""
        with waiting("comparing transfer curves"):
            frames = self.frames
            other = explaining_curve(
                frames, found.plate, found.in_frames, frames.frame_numbers, found.camera
            )
        if other is not None:
            warn(
                f"{self.source}: in some frames no disc on a path explains the streak, but with "
                f"--transfer {other.name} one does; the curve that was assumed seems to be wrong"
            )

    @contextmanager
    def _recorded(
        self, files: tuple[Path, ...], settings: dict[str, Any]
    ) -> Iterator[tuple[list[FrameSightings], Callable[[FrameSightings], None]]]:
        """What an interrupted run with the same inputs and settings measured; what records more."""
        with opened_manifest(self.unfinished, key_of(files, settings), Finished) as manifest:
            seen = [one.seen for one in manifest.finished if one.seen is not None]
            try:
                yield seen, lambda frame: manifest.append(Finished(1, seen=frame))
            except BaseException:
                if manifest.finished and self.unfinished is not None:
                    complain(f"{self.unfinished}: keeps the finished frames; run the same again")
                raise

    def answer(
        self,
        found: tuple[ClipMeasured, Places | None, KnownQuantities],
        overlay: Path | None,
        as_json: bool,
    ) -> None:
        """Write the table and the sheet, and print their contents."""
        clip, places, known = found
        rows, several = clip.rows, clip.clip.several
        with about(self.source):
            objects = summaries(rows, places, several, known)
        color = WITHOUT_HUE if clip.is_gray else in_degrees(clip.seen_color)
        said = clip_in_words(rows, color, several)
        said += Cadence.stated(rows).words
        said += [word for one in objects for word in summary_in_words(one, several)]
        said += camera_in_words(clip.camera, clip.clip.numbers)
        lines = clip_table(clip.in_frames, places, objects, known)
        if self.out is not None:
            bm.write(self.out, lines)
        if overlay is not None:
            with waiting("drawing the paths"):
                physics = bm.figures.ClipPhysics.of(lines, objects, places)
                sheet = bm.figures.draw_clip(clip.plate, rows, said, physics, self.source.name)
                bm.write(overlay, sheet)
        if self.unfinished is not None:
            remove_unfinished(self.unfinished)
        falls = [_of_fall(one) for one in objects]
        numbers: dict[str, Any] = {"rows": lines, "camera_moves": clip.camera is not None}
        numbers |= {"falls": falls} if several else {"fall": falls[0]}
        answer(as_json, {**numbers, "in_words": said}, said)


def _of_fall(one: ObjectSummary) -> dict[str, Any] | None:
    """The parabola of an object, the frames without weight in it, and why it is no fall."""
    if one.fall is None:
        return None
    fall = one.fall
    return {"object": one.number, **fall.numbers(), "off": fall.off, "rejection": fall.rejection}


def remove_unfinished(path: Path) -> None:
    """Remove the kept frames; the table is written."""
    path.unlink(missing_ok=True)


def check_times(known: KnownQuantities, rate: float | None, rows: int) -> None:
    """Raise ValueError if exposure or readout takes longer than a frame."""
    if rate is None:
        return
    line_time, exposure = known.line_time, known.exposure
    if line_time * rows * rate > MAX_READOUT:
        raise ValueError(
            "give --line-time with its unit, like 15us, or the true --rate: "
            f"{line_time:g} s are {line_time * rows:.3g} s for {rows} rows, longer than a frame, "
            f"{1 / rate:.3g} s"
        )
    if exposure is not None and exposure[0] * rate > MAX_READOUT:
        raise ValueError(
            "give --exposure with its unit, like 4ms, or the true --rate: "
            f"{exposure[0]:g} s is longer than a frame, {1 / rate:.3g} s"
        )
