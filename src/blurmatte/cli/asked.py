"""What `solve` and `color` are asked: where the object is in the pictures, and its color."""

import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import blurmatte as bm
from blurmatte.cli.inputs import Files, box_of, numbers
from blurmatte.cli.printing import by


@dataclass(frozen=True)
class Asked:
    """What the options of `solve` and `color` say of the color and the place of the object.

    Raises
    ------
    ValueError
        If they contradict each other, whatever the pictures show.
    """

    colors: tuple[str, ...]
    color_from: Path | None
    rank: int
    region: str | None
    mask: Path | None
    max_brightness: float | None

    def __post_init__(self) -> None:
        if self.region is not None and self.mask is not None:
            raise ValueError("give --region or --mask, not both")
        if self.region is not None:
            box_of(self.region)
        if self.rank not in (1, 2, 3):
            raise ValueError(f"--rank must be 1, 2 or 3, got {self.rank}")
        if self.max_brightness is not None and not self.max_brightness > 0:
            raise ValueError(f"--max-brightness must be above 0, got {self.max_brightness:g}")
        self._check_colors()

    def _check_colors(self) -> None:
        kinds = self.kinds
        if self.color_from is not None and "point" not in kinds:
            raise ValueError("--color-from needs points to pick: add --color X,Y")
        if not kinds and self.rank == 2:
            raise ValueError("--rank 2 needs colors: give two with --color, hex or points")
        if kinds and self.rank == 3:
            raise ValueError("--rank 3 is for objects of any colors: leave --color out")
        if len(kinds & {"hex", "file"}) and len(kinds) > 1:
            raise ValueError("give hex colors, or a model file, or points and core: not a mixture")
        if kinds == {"file"} and len(self.colors) > 1:
            raise ValueError("give one model file, not several")
        if kinds == {"hex"} and len(self.colors) != self.rank:
            raise ValueError(
                f"--rank {self.rank} takes {self.rank} hex color{'s' * (self.rank - 1)}, got "
                f"{len(self.colors)}: one color is --rank 1, two colors are --rank 2"
            )

    @property
    def kinds(self) -> set[str]:
        """What the colors are: hex, file, point, core."""
        return {kind(color) for color in self.colors}


@dataclass(frozen=True)
class Task:
    """What the options of `solve` and `color` ask for."""

    files: Files
    asked: Asked

    def streak(self, image: bm.LinearImage, plate: bm.LinearImage) -> bm.Streak | None:
        """Where to look; None: wherever something moved."""
        if self.asked.region is not None:
            inside = bm.Streak.from_box(box_of(self.asked.region), image.size)
            found = bm.find_streak_within(inside, image, plate)
            if found is inside:
                warnings.warn(
                    f"nothing is found to move in --region {self.asked.region}; all of it is taken "
                    "for the streak",
                    bm.BlurmatteWarning,
                    stacklevel=2,
                )
            return found
        if self.asked.mask is None:
            return None
        inside = self.white("mask", self.asked.mask, image)
        if not inside.any():
            raise ValueError(
                f"the mask {self.asked.mask} is white nowhere; it must be where the object moved"
            )
        return bm.Streak(inside)

    def hidden(self, path: Path, image: bm.LinearImage) -> Any:
        """(H, W) bool: where something still is in front."""
        white = self.white("occluder", path, image)
        if white.all():
            raise ValueError(
                f"the occluder {path} is white everywhere; it must be black where nothing is in front"
            )
        return white

    def white(self, name: str, path: Path, image: bm.LinearImage) -> Any:
        """(H, W) bool: where a picture of the image's size is more than half white."""
        picture = bm.read(path, bm.LINEAR, self.files.max_pixels)
        if picture.size != image.size:
            raise ValueError(
                f"the {name} {path} is {by(picture.size)} pixels, the image {by(image.size)}"
            )
        return np.asarray(picture.rgb.max(axis=-1) > 0.5)

    def model(
        self, image: bm.LinearImage, plate: bm.LinearImage, streak: bm.Streak | None
    ) -> bm.ColorModel | None:
        """The model that the colors make; None: the streak itself must tell."""
        colors, kinds = self.asked.colors, self.asked.kinds
        if not kinds:
            return self._fitted(image, plate, streak)
        if kinds == {"file"}:
            return self._from_file(image)
        if kinds == {"hex"}:
            return bm.ColorModel.from_hex(*colors, to_srgb=image.meta.to_srgb)
        samples = np.concatenate([self._samples(c, image, plate, streak) for c in colors])
        model = bm.ColorModel.from_samples(samples, self.asked.rank, robust="core" in kinds)
        return replace(model, to_srgb=image.meta.to_srgb)

    def _fitted(
        self, image: bm.LinearImage, plate: bm.LinearImage, streak: bm.Streak | None
    ) -> bm.ColorModel | None:
        if self.asked.rank == 3:
            return bm.ColorModel.any()
        if self.asked.max_brightness is None:
            return None
        return bm.fit_color(image, plate, streak, self.asked.max_brightness)

    def _from_file(self, image: bm.LinearImage) -> bm.ColorModel:
        (path,) = self.asked.colors
        model = bm.read_color_model(path)
        if (model.to_srgb is None) != (image.meta.to_srgb is None):
            raise bm.ColorModelError(
                f"{path} was found in a picture of another kind: a camera RAW has the "
                "camera's own colors; find the color in a picture like IMAGE"
            )
        return model

    def _samples(
        self, color: str, image: bm.LinearImage, plate: bm.LinearImage, streak: bm.Streak | None
    ) -> Any:
        from blurmatte.radiometry import check_same_colors

        if color == "core":
            return bm.core_colors(image, plate, streak)
        x, y, *radius = numbers("--color", color, "x,y", "x,y,radius")
        if self.asked.color_from is None:
            return bm.pick_colors(image, x, y, *radius)
        sharp = self.files.read(self.asked.color_from)[0]
        check_same_colors("the image", image, "the picture of --color-from", sharp)
        return bm.pick_colors(sharp, x, y, *radius)


def kind(color: str) -> str:
    """What a value of --color is: hex, file, point or core."""
    if color == "core":
        return "core"
    if color.lower().endswith(".json"):
        return "file"
    return "point" if "," in color else "hex"
