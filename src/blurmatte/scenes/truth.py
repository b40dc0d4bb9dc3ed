"""Ground truth of a scene and the answer of a program, read from their folders."""

from dataclasses import dataclass, replace
from pathlib import Path

from blurmatte.errors import FileError
from blurmatte.files import read, read_layer, read_path, read_solution
from blurmatte.layer import Layer
from blurmatte.matting.solution import Solution
from blurmatte.radiometry import LINEAR, LinearImage
from blurmatte.trajectory import Trajectory

LAYER_FILES = ("layer.exr", "layer.png", "layer.tif", "alpha.png")


@dataclass(frozen=True, eq=False)
class Truth:
    """The truth of a scene that `save_shot` wrote."""

    layer: Layer  # true alpha and premultiplied light
    plate: LinearImage  # the plate behind the object, without noise
    trajectory: Trajectory  # true path of the center
    radius: float  # extent of the object from its center at the start, pixels
    subframes: tuple[Layer, ...]  # sharp layers at the middles of equal parts of the exposure


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer of a program to a scene."""

    layer: Layer  # alpha and premultiplied light; the light is 0 if `alpha_only`
    alpha_only: bool = False  # true if the program estimates no color
    # Estimates with their standard deviations, if blurmatte wrote it
    solution: Solution | None = None
    trajectory: Trajectory | None = None  # path of the object's center
    subframes: tuple[Layer, ...] | None = None  # sharp layers, as many as in the truth


def find_scenes(folder: str | Path) -> list[Path]:
    """The folder itself if it holds a scene, else all scene folders in it, sorted.

    Raises
    ------
    FileError
        If there is no scene.
    """
    place = Path(folder)
    if (place / "truth").is_dir():
        return [place]
    scenes = sorted(truth.parent for truth in place.glob("**/truth") if truth.is_dir())
    if not scenes:
        raise FileError(
            f"{folder}: holds no scene with its truth; give a folder that blurmatte render wrote, "
            "or a folder of them"
        )
    return scenes


def read_truth(folder: str | Path) -> Truth:
    """Read the truth of a scene from the folder that `save_shot` wrote.

    Raises
    ------
    FileError
        If the folder holds no scene.
    """
    truth = Path(folder) / "truth"
    trajectory, radius = read_path(truth / "path.json")
    if radius is None:
        raise FileError(f"{truth / 'path.json'}: has no radius; render the scene again")
    plate, layer = read(truth / "plate.exr"), read_layer(truth / "layer.exr")
    return Truth(layer, plate, trajectory, radius, _subframes(truth) or ())


def read_answer(path: str | Path) -> Answer:
    """Read the answer of a program: one file, or a folder of files.

    ================================  ======================================================
    layer.exr, layer.png, layer.tif   alpha and color: EXR linear and premultiplied, PNG straight
    alpha.png                         alpha only, gray, linear, if there is no layer
    path.json                         {"xy": [[x, y], …], "t": [0, …, 1]}, optional
    subframe_00.exr …                 sharp layers, as many as in the truth, optional
    ================================  ======================================================

    Raises
    ------
    FileError
        If there is no answer or it cannot be read.
    """
    place = Path(path)
    if not place.is_dir():
        return _layer_answer(place)
    names = [name for name in LAYER_FILES if (place / name).is_file()]
    if not names:
        raise FileError(f"{path}: holds no result; one of {', '.join(LAYER_FILES)} is needed")
    answer, path_file = _layer_answer(place / names[0]), place / "path.json"
    trajectory = read_path(path_file)[0] if path_file.is_file() else None
    return replace(answer, trajectory=trajectory, subframes=_subframes(place))


def _layer_answer(path: Path) -> Answer:
    if path.name == "alpha.png":
        picture = read(path, LINEAR)
        if not picture.meta.gray:
            raise FileError(f"{path}: has colors; an alpha.png is gray")
        return Answer(Layer(picture.rgb[..., 0], 0 * picture.rgb), alpha_only=True)
    layer = read_layer(path)
    try:
        return Answer(layer, solution=read_solution(path))
    except FileError:  # a layer of another program
        return Answer(layer)


def _subframes(folder: Path) -> tuple[Layer, ...] | None:
    files = sorted(folder.glob("subframe_*.exr"))
    return tuple(read_layer(file) for file in files) or None
