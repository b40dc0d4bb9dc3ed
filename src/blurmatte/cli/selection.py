"""Which pictures are read and how, and where in them the object is and which color it has."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import blurmatte as bm
from blurmatte.cli.console import GENERAL, about, argument, option, optional, output
from blurmatte.cli.paths import ROWS
from blurmatte.cli.quantities import box, check_rate, frame_range, is_box, numbers
from blurmatte.formats import EXR, MAX_PIXELS, format_at, named

OBJECT = "The object"
PICTURES = "Its pictures"
Out = Annotated[Path, output("Where to write.")]
OutFolder = Annotated[Path, output("For the results; made if needed.", "FOLDER")]
Layer = Annotated[Path, argument("LAYER", "The layer.exr that solve wrote.")]
Clip = Annotated[list[str], argument("CLIP", f"A clip, or pictures: {ROWS}.")]
FrameRange = Annotated[
    str | None,
    option("START:STOP[:STEP]", "Their numbers, or seconds: 40:52, 2.5s:4s.", None, "--frames"),
]
Region = Annotated[
    str | None, option("X0,Y0,X1,Y1|FILE", "Where it moved: a box, or a white mask.", OBJECT)
]
Occluder = Annotated[
    Path | None, option("FILE", "A mask, white where something is in front.", OBJECT)
]

_MATCH = "Changes: auto, none, exposure, shift or full."
MatchMode = Annotated[str, option("MODE", _MATCH)]
KnownOpacity = Annotated[
    str | None, option("solid|any", "If it surely is solid; if it may be glass.", OBJECT)
]


@dataclass(frozen=True)
class Reading:
    """How picture files are read."""

    transfer: str | None = optional(
        "NAME|FILE.json", "Encoding: srgb, rec709, linear, slog3 …", GENERAL
    )
    max_pixels: int = optional(
        "N", "Refuse larger pictures; 200 million.", GENERAL, default=MAX_PIXELS
    )

    @property
    def camera_noise(self) -> bm.NoiseModel | None:
        """The noise of the camera, if it was given."""
        return None

    @property
    def curve(self) -> bm.radiometry.Transfer | None:
        """The transfer curve that was asked for; None: what the file says."""
        if self.transfer is None:
            return None
        if self.transfer.lower().endswith(".json"):
            return bm.read_transfer(self.transfer)
        return bm.radiometry.named_transfer(self.transfer)

    def curve_of(self, path: Path | str) -> bm.radiometry.Transfer | None:
        """The curve of one file; an EXR holds linear light whatever was asked for."""
        return None if format_at(path) is EXR else self.curve

    def read(self, path: Path, said: list[str] | None = None) -> bm.LinearImage:
        """The picture; its warnings are also added to `said`."""
        with about(path) as notes:
            picture = bm.read(path, self.curve_of(path), self.max_pixels)
            if (picture.rgb > 1).mean() > 0.5:
                bm.errors.warn(
                    "more than half of its light is above that of white, 1, and surfaces are taken to "
                    "be no brighter; divide it by white, or code values by the largest one"
                )
        noise = self.camera_noise
        if noise is not None and picture.noise is None:
            picture = picture.with_noise(noise)
        if said is not None:
            said += notes
        return picture

    def behind(
        self, image: bm.LinearImage, plate: Path, match: str, streak: Callable[[], Any]
    ) -> bm.LinearImage:
        """The scene behind an object: the plate, matched to the image, or a guess behind the streak."""
        if plate == GUESSED:
            return guess_behind(image, streak())
        scene = self.read(plate)
        with about(plate):
            return bm.match_plate(scene, image, matching_of(match))

    def frames(self, clip: list[str], chosen: str | None) -> bm.Frames[bm.LinearImage]:
        """The chosen frames of a clip, or of a row of pictures."""
        source = clip[0] if len(clip) == 1 else clip
        form = format_at(source) if isinstance(source, str) and Path(source).is_file() else None
        if form is not None and form.one_picture:
            raise bm.errors.FileError(
                f"{source}: give a clip, or several pictures; it is one picture ({form})"
            )
        return chosen_frames(bm.read_frames(source, self.curve, self.max_pixels), chosen)

    def mask(self, name: str, path: Path, size: tuple[int, int]) -> Any:
        """(H, W) bool: where a picture of a size is opaque or, without alpha, white."""
        inside = bm.read_mask(path, self.max_pixels)
        if inside.shape[::-1] != size:
            raise ValueError(
                "the {} {} must have the size of the image; it is {}x{}, the image {}x{}".format(
                    name, path, *inside.shape[::-1], *size
                )
            )
        return inside


@dataclass(frozen=True)
class CameraReading(Reading):
    """How picture files of a camera with known noise are read."""

    noise: Path | None = optional("FILE.json", "From calibrate noise; else measured.")

    @property
    def camera_noise(self) -> bm.NoiseModel | None:
        """The noise in the file that was named."""
        return None if self.noise is None else bm.read_noise(self.noise)


@dataclass(frozen=True)
class FrameSelection:
    """Which frames of a clip or of a row of pictures are used, and when they were taken."""

    frames: FrameRange = None
    rate: float | None = optional("R", "Frames per second, instead of the file's.")

    def __post_init__(self) -> None:
        check_rate(self.rate)
        frame_range("--frames", self.frames)


@dataclass(frozen=True)
class PlateOptions:
    """The plate, and how it may be changed to match the image."""

    plate: Annotated[Path, option("FILE|none", "The same scene without the object; none: guess.")]
    match: MatchMode = "auto"

    def __post_init__(self) -> None:
        matching_of(self.match)


@dataclass(frozen=True)
class SourceFiles:
    """The pictures that a layer is from, and how the plate may be changed to match the image."""

    image: Path | None = optional("FILE", "With the object.", PICTURES)
    plate: Path | None = optional("FILE|none", "Without it; none: guess.", PICTURES)
    match: str = optional("MODE", _MATCH, PICTURES, default="auto")

    def __post_init__(self) -> None:
        matching_of(self.match)


GUESSED = Path("none")  # a plate that was not taken: what the object hides is guessed


def guess_behind(image: bm.LinearImage, streak: Any, grow: int = 0) -> bm.background.PlateGuess:
    """The scene behind the streak, (H, W) bool, of a layer; warns that it is a guess, and how good."""
    guess = bm.background.guess.guess_behind(image, streak, grow)
    bm.errors.warn(
        "what is behind the object is a guess from its surroundings, "
        f"within {guess.error:.2g} of white"
    )
    return guess


def check_photographed(plate: Path | None, remedy: str) -> None:
    """Raise ValueError for `--plate none` where a plate is needed."""
    if plate == GUESSED:
        raise ValueError(f"--plate none guesses what one solved picture hides; {remedy}")


@dataclass(frozen=True)
class ObjectColor:
    """The color of the object as the options give it.

    Raises ValueError if they contradict each other, whatever the pictures show.
    """

    color: list[str] | None = optional(
        "HEX|X,Y[,R]|FILE|core", "#d8ff3c, its pixels, a model; repeatable.", OBJECT
    )
    color_from: Path | None = optional("FILE", "A sharp picture in which X,Y are picked.", OBJECT)
    rank: int = optional("1|2|3", "1: shades of one color, 2: of two, 3: any.", OBJECT, default=1)
    max_brightness: float | None = optional("L", "Its light at most; white is 1.", OBJECT)

    def __post_init__(self) -> None:
        if self.rank not in (1, 2, 3):
            raise ValueError(f"--rank must be 1, 2 or 3, got {self.rank}")
        if self.max_brightness is not None and not self.max_brightness > 0:
            raise ValueError(f"--max-brightness must be above 0, got {self.max_brightness:g}")
        kinds = self.kinds
        if self.color_from is not None and "point" not in kinds:
            raise ValueError("--color-from needs points to pick: add --color X,Y")
        if not kinds and self.rank == 2:
            raise ValueError("--rank 2 needs colors: give two with --color, hex or points")
        if kinds and self.rank == 3:
            raise ValueError("--rank 3 is for objects of any colors: leave --color out")
        if len(kinds & {"hex", "file"}) and len(kinds) > 1:
            raise ValueError("give hex colors, or a model file, or points and core: not a mixture")
        self._check_count()

    def _check_count(self) -> None:
        count = len(self.color or ())
        if self.kinds == {"file"} and count > 1:
            raise ValueError("give one model file, not several")
        if self.kinds == {"hex"} and count != self.rank:
            raise ValueError(
                f"--rank {self.rank} takes {self.rank} hex color{'s' * (self.rank - 1)}, got "
                f"{count}: one color is --rank 1, two colors are --rank 2"
            )

    @property
    def files(self) -> tuple[str | Path | None, ...]:
        """The values that may name files."""
        return *(self.color or ()), self.color_from

    @property
    def kinds(self) -> set[str]:
        """What the colors are: hex, file, point, core."""
        return {kind_of_color(color) for color in self.color or ()}


@dataclass(frozen=True)
class Selection:
    """Where the object is in the pictures, and which color it has."""

    reading: Reading
    colors: ObjectColor
    region: str | None

    def __post_init__(self) -> None:
        if self.region is not None and not is_mask(self.region):
            box("--region", self.region)

    def streak(self, image: bm.LinearImage, plate: bm.LinearImage) -> bm.streaks.Streak | None:
        """The pixels to solve; None: wherever something moved."""
        within = self.inside(image.size)
        if within is None or is_mask(self.region or ""):
            return within
        found = bm.streaks.find_streak_within(within, image, plate)
        if found is within:
            bm.errors.warn(
                f"no motion is found in --region {self.region}; all of it is taken for the streak"
            )
        return found

    def inside(self, size: tuple[int, int]) -> bm.streaks.Streak | None:
        """The box or the mask of the region in pictures of this size; None without a region."""
        if self.region is None:
            return None
        if not is_mask(self.region):
            return bm.streaks.Streak.from_box(box("--region", self.region), size)
        inside = self.reading.mask("mask", Path(self.region), size)
        if not inside.any():
            raise ValueError(
                f"the mask {self.region} has no white pixel, or no opaque one if it has alpha; "
                "mark where the object moved"
            )
        return bm.streaks.Streak(inside)

    def hidden(self, path: Path, size: tuple[int, int]) -> Any:
        """(H, W) bool: where something still is in front."""
        white = self.reading.mask("occluder", path, size)
        if white.all():
            raise ValueError(f"the occluder {path} marks all pixels; mark only what is in front")
        return white

    def model(
        self, image: bm.LinearImage, plate: bm.LinearImage, streak: bm.streaks.Streak | None
    ) -> bm.ColorModel | None:
        """The color model of the options; None: it is to be found from the streak."""
        colors, kinds, rank = self.colors.color or [], self.colors.kinds, self.colors.rank
        if not kinds and rank == 3:
            return bm.ColorModel.any()
        if not kinds:
            bound = self.colors.max_brightness
            return None if bound is None else bm.fit_color(image, plate, streak, bound)
        if kinds == {"file"}:
            return self._from_file(image)
        if kinds == {"hex"}:
            return bm.ColorModel.from_hex(*colors, to_srgb=image.meta.to_srgb)
        import numpy as np  # not for --help

        samples = np.concatenate([self._samples(c, image, plate, streak) for c in colors])
        model = bm.ColorModel.from_samples(samples, rank, robust="core" in kinds)
        return replace(model, to_srgb=image.meta.to_srgb)

    def _from_file(self, image: bm.LinearImage) -> bm.ColorModel:
        (path,) = self.colors.color or [""]
        model = bm.read_color_model(path)
        if (model.to_srgb is None) != (image.meta.to_srgb is None):
            raise bm.errors.ColorModelError(
                f"{path} was found in a picture of another kind: a camera RAW has the "
                "camera's own colors; find the color in a picture like IMAGE"
            )
        return model

    def _samples(
        self,
        color: str,
        image: bm.LinearImage,
        plate: bm.LinearImage,
        streak: bm.streaks.Streak | None,
    ) -> Any:
        from blurmatte.radiometry import check_same_colors

        if color == "core":
            return bm.color.core_colors(image, plate, streak)
        x, y, *radius = numbers("--color", color, "x,y", "x,y,radius")
        if self.colors.color_from is None:
            return bm.color.pick_colors(image, x, y, *radius)
        sharp = self.reading.read(self.colors.color_from)
        check_same_colors("the image", image, "the picture of --color-from", sharp)
        return bm.color.pick_colors(sharp, x, y, *radius)


def stated_model(colors: Sequence[str]) -> bm.ColorModel:
    """The model of a file, or of hex colors."""
    if kind_of_color(colors[0]) == "file":
        return bm.read_color_model(colors[0])
    return bm.ColorModel.from_hex(*colors)


def kind_of_color(color: str) -> str:
    """What a value of --color is: hex, file, point or core.

    All commands read it so; those without a single picture to pick colors in refuse points and core.
    """
    if color == "core":
        return "core"
    if color.lower().endswith(".json"):
        return "file"
    return "point" if "," in color else "hex"


def is_mask(region: str) -> bool:
    """Whether a value of --region names a picture."""
    return not is_box(region) and (named(region) is not None or Path(region).is_file())


def matching_of(name: str) -> bm.background.Matching | None:
    """The matching of a name; None: what the pictures ask for."""
    names = ["auto", *(matching.value for matching in bm.background.Matching)]
    if name not in names:
        raise ValueError(f"--match must be {', '.join(names[:-1])} or {names[-1]}, got {name!r}")
    return None if name == "auto" else bm.background.Matching(name)


def opacity_of(name: str | None) -> bm.sweep.OpacityPrior:
    """What is known of the opacity; None: that most objects are solid."""
    priors = bm.sweep.OpacityPrior
    if name is None:
        return priors.USUAL
    if name not in (priors.SOLID, priors.ANY):
        raise ValueError(f"--opacity must be solid or any, got {name!r}")
    return priors(name)


def chosen_frames(frames: bm.Frames[bm.LinearImage], text: str | None) -> bm.Frames[bm.LinearImage]:
    """The frames of --frames; ValueError if there are none."""
    known = frames.picture_numbers
    chosen = frames[frame_range("--frames", text, frames.times, known)]
    first, last = (frames.times or (0.0, 0.0))[0], (frames.times or (0.0, 0.0))[-1]
    if len(chosen) == 0:
        span = "" if frames.times is None else f"; they are from {first:.4g} s to {last:.4g} s"
        span = span if known is None else f"; they are numbered {known[0]} to {known[-1]}"
        raise ValueError(f"--frames selects no frame{span}; check its numbers")
    if "s" in (text or "") and first * (frames.rate or 0) > 1:
        bm.errors.warn(
            f"its first frame is at {first:.4g} s; the seconds of --frames are those of the file"
        )
    return chosen
