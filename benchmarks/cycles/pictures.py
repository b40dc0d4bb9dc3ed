"""Pictures with a known truth on disk: `root`/pictures/`part`/`scene`/`camera`/.

=======================  =====================================================================
image.png or image.jpg   the picture with the object, as the camera's file holds it
plate.png or plate.jpg   the same scene without it
truth/                   as `blurmatte.scenes.save_shot` writes it; truth.json has `Facts` too
truth/layer_1.exr        of two objects that cross: the first alone
=======================  =====================================================================
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Floats
from blurmatte.color.model import ColorModel
from blurmatte.files.models import path_to_mapping, read_color_model
from blurmatte.files.reading import read, read_layer
from blurmatte.files.writing import write, write_together
from blurmatte.layer import Layer
from blurmatte.radiometry import LinearImage
from blurmatte.scenes import read_truth
from blurmatte.scenes.score import Truth
from blurmatte.trajectory import Trajectory

Content = bytes | npt.NDArray[np.uint8] | LinearImage  # of a picture's file

LEARN, TUNE, SEALED, OWN = "learn", "tune", "sealed", "own"
CYCLES, BLURMATTE = "cycles", "blurmatte"  # renderers
_KNOWN_COLOR_STD = 1e-9  # light: of a color that is given exactly
_OPTIONAL = ("layer_1.exr", "model.json")
_NEEDED = ("truth.json", "layer.exr", "plate.exr", "path.json")


@dataclass(frozen=True)
class Facts:
    """What truth.json says of a picture.

    Parameters
    ----------
    kind, room : str
        Of the object, and of the scene around it.
    camera_class : str
        "png", "phone", or another.
    renderer : str
        "cycles" or "blurmatte".
    round : bool
        The object is a ball: path and radius in path.json are those of a disc.
    alpha_std, light_std : float
        Sampling noise of the truth: standard deviation of alpha and of premultiplied light.
    mean_color : 3 floats
        Mean straight linear light of the object.
    """

    kind: str
    room: str
    camera_class: str
    renderer: str
    round: bool
    alpha_std: float
    mean_color: tuple[float, float, float]
    light_std: float = 0.0


@dataclass(frozen=True)
class Picture:
    """Where a picture and its truth lie, and what identifies it."""

    root: Path
    part: str
    scene: str
    camera: str

    @property
    def folder(self) -> Path:
        """That of its files."""
        return self.root / "pictures" / self.part / self.scene / self.camera

    @property
    def whole(self) -> bool:
        """Whether all files are there: rendering may be going on."""
        named = (self.folder / "truth" / name for name in _NEEDED)
        return all(map(Path.is_file, named)) and all(map(self._files, ("image", "plate")))

    @cached_property
    def facts(self) -> Facts:
        """What truth.json says.

        Raises
        ------
        ValueError
            If something is missing there.
        """
        path = self.folder / "truth" / "truth.json"
        fields: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        fields = {name: fields[name] for name in Facts.__dataclass_fields__ if name in fields}
        try:
            facts = Facts(**fields)
        except TypeError as error:
            raise ValueError(f"{path}: {error}; render the scene again") from error
        r, g, b = facts.mean_color
        return replace(facts, mean_color=(r, g, b))

    @cached_property
    def digest(self) -> str:
        """Of the files that outcomes depend on: a picture that is rendered again has another."""
        names = (*_NEEDED, *_OPTIONAL)
        truth = (path for name in names if (path := self.folder / "truth" / name).is_file())
        found = hashlib.sha256()
        for path in (*self._files("image"), *self._files("plate"), *truth):
            found.update(path.read_bytes())
        return found.hexdigest()[:16]

    @property
    def unchanged(self) -> bool:
        """Whether the files are still those of `digest`: rendering again may remove or replace them."""
        now = replace(self)
        try:
            return now.whole and now.digest == self.digest
        except FileNotFoundError:
            return False

    def read(self) -> tuple[LinearImage, LinearImage]:
        """Image and plate, read as any user's files.

        Raises
        ------
        FileNotFoundError
            If they are not there.
        """
        image, plate = map(self._files, ("image", "plate"))
        if not (image and plate):
            raise FileNotFoundError(f"{self.folder}: has no image and plate, as PNG or JPEG")
        return read(image[0]), read(plate[0])

    def truth(self) -> Truth:
        """The truth, as `blurmatte score` reads it."""
        return read_truth(self.folder)

    def answers(self, truth: Truth) -> tuple[Layer, ...]:
        """The layers that are right: of all that moved, or of one of two objects that cross."""
        path = self.folder / "truth" / "layer_1.exr"
        if not path.is_file():
            return (truth.layer,)
        whole, first = truth.layer, read_layer(path)
        second = Layer(
            _not_negative(whole.alpha - first.alpha),
            _not_negative(whole.premultiplied - first.premultiplied),
        )
        return whole, first, second

    def model(self) -> ColorModel:
        """The true colors: those of model.json, or else the line of the mean color."""
        path = self.folder / "truth" / "model.json"
        if path.is_file():
            return read_color_model(path)
        return ColorModel.from_samples(np.array([self.facts.mean_color]), std=_KNOWN_COLOR_STD)

    def _files(self, name: str) -> list[Path]:
        return [path for end in ("png", "jpg") if (path := self.folder / f"{name}.{end}").is_file()]


@dataclass(frozen=True, eq=False)
class TrueShot:
    """What is true of a picture, as its camera saw it.

    Parameters
    ----------
    layer : Layer
        Alpha and premultiplied light.
    image, plate : LinearImage
        Without noise.
    trajectory : Trajectory
        Of the object's center.
    radius : float
        Pixels.
    model : ColorModel, optional
        The object's colors, if they form a line or a plane.
    first : Layer, optional
        Of two objects that cross: the first alone.
    """

    layer: Layer
    image: LinearImage
    plate: LinearImage
    trajectory: Trajectory
    radius: float
    model: ColorModel | None = None
    first: Layer | None = None


def write_picture(
    picture: Picture, files: Mapping[str, Content], shot: TrueShot, facts: Facts
) -> None:
    """Write a picture and its truth; it is whole when the last file is there.

    Parameters
    ----------
    picture : Picture
        Where.
    files : mapping
        Image and plate by names such as "image.jpg": a file's content, or for a PNG (H, W, 3) uint8
        sRGB codes, or light that is written with 16 bits.
    shot : TrueShot
    facts : Facts

    Raises
    ------
    FileError
        If a file of the truth cannot be written.
    """
    picture.folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        if isinstance(content, bytes):
            (picture.folder / name).write_bytes(content)
        else:
            write(picture.folder / name, content)
    names = {"part": picture.part, "scene": picture.scene, "camera": picture.camera}
    things = {
        "layer.exr": shot.layer,
        "image.exr": shot.image,
        "plate.exr": shot.plate,
        "path.json": path_to_mapping(shot.trajectory, shot.radius),
        "model.json": shot.model,
        "layer_1.exr": shot.first,
        "truth.json": {**names, **asdict(facts)},
    }
    given = {name: thing for name, thing in things.items() if thing is not None}
    write_together(picture.folder / "truth", given)


def find_pictures(
    root: Path, parts: Sequence[str], cameras: Sequence[str] | None = None
) -> list[Picture]:
    """All whole pictures of some parts, by the given cameras or by all.

    Scenes come in the order of a digest of their names, so that the first of them are of all kinds.
    """
    found = [
        Picture(root, part, folder.parent.name, folder.name)
        for part in parts
        for folder in (root / "pictures" / part).glob("*/*")
        if cameras is None or folder.name in cameras
    ]
    return sorted(filter(lambda picture: picture.whole, found), key=_mixed)


def _mixed(picture: Picture) -> tuple[str, str]:
    return hashlib.sha256(picture.scene.encode()).hexdigest(), picture.camera


def _not_negative(values: Floats) -> Floats:
    return np.asarray(np.maximum(values, 0), values.dtype)
