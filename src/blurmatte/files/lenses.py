"""Calibrated cameras in the words of the programs that write them.

blurmatte and OpenCV [FileStorage, and its calibration samples] write JSON or YAML, ROS [camera_info]
and Kalibr [camchain] YAML, COLMAP a text, cameras.txt. A key or a model that is not known is refused,
because without it the lens may be another one.

YAML is read by PyYAML. Tags such as `!!opencv-matrix` are skipped. Aliases are refused, since a short
text could stand for a huge one.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import AfterValidator, AliasChoices, BeforeValidator, Field

from blurmatte.checks import MAX_PX, Array
from blurmatte.errors import FileError
from blurmatte.files.documents import (
    DocumentError,
    checked_json,
    covariance_matrix,
    document,
    numbers,
    parse_json,
    read_document,
    to_json,
)
from blurmatte.intrinsics import Intrinsics

MIN_FOCAL_LENGTH = 1e-3  # pixels

_PINHOLE = "fx", "fy", "cx", "cy"
_HINT = (
    "give {fx, fy, cx, cy}, optionally with distortion, fisheye, std, covariance, size; or a "
    "calibration of OpenCV, ROS, Kalibr or COLMAP"
)
_WHAT = "calibrated camera"
# Keys that say how a lens was found, how it is turned, or how to rectify: not how it projects.
_ABOUT = frozenset(
    (
        *("calibration_time", "nframes", "nr_of_frames", "board_width", "board_height"),
        *("squares_x", "squares_y", "square_size", "marker_size"),
        *("aspectRatio", "fix_aspect_ratio", "flags"),
        *("avg_reprojection_error", "per_view_reprojection_errors", "extrinsic_parameters"),
        *("image_points", "grid_points", "rms", "camera_name", "header", "frame_id"),
        *("rectification_matrix", "projection_matrix", "R", "r", "P", "p", "rostopic", "topic"),
        *("T_cam_imu", "T_cn_cnm1", "T_BS", "cam_overlaps", "timeshift_cam_imu", "sensor_type"),
        *("comment", "rate_hz", "T_imu_cam", "line_delay"),
    )
)
_RADIAL = ("plumb_bob", "rational_polynomial", "radtan", "radial-tangential", "none", "")
_FISHEYE = ("equidistant", "equi", "fisheye", "kannala_brandt", "kannala_brandt4")
# Parameters of COLMAP's models after their name and size; 0 stands for one that they lack.
_COLMAP = {
    "SIMPLE_PINHOLE": ("f cx cy", ""),
    "PINHOLE": ("fx fy cx cy", ""),
    "SIMPLE_RADIAL": ("f cx cy k1", "k1 0 0 0"),
    "RADIAL": ("f cx cy k1 k2", "k1 k2 0 0"),
    "OPENCV": ("fx fy cx cy k1 k2 p1 p2", "k1 k2 p1 p2"),
    "FULL_OPENCV": ("fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6", "k1 k2 p1 p2 k3 k4 k5 k6"),
    "SIMPLE_RADIAL_FISHEYE": ("f cx cy k1", "k1 0 0 0"),
    "RADIAL_FISHEYE": ("f cx cy k1 k2", "k1 k2 0 0"),
    "OPENCV_FISHEYE": ("fx fy cx cy k1 k2 k3 k4", "k1 k2 k3 k4"),
}
# The directive of OpenCV, which no version of YAML has.
_OPENCV_DIRECTIVE = re.compile(r"\A%YAML:1\.0\s*")
# PyYAML reads 1e-5 as a text: YAML 1.1 asks for a point.
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")
_FLOAT = "tag:yaml.org,2002:float"


def read_intrinsics(path: str | Path) -> Intrinsics:
    """Read a calibrated camera from a JSON, a YAML or COLMAP's cameras.txt.

    Either `fx`, `fy`, `cx`, `cy` in pixels, and optionally `distortion` (k1, k2, p1, p2, k3 …),
    `fisheye` (true or false) and `std` or `covariance` of all of these in this order; or what
    OpenCV's FileStorage, ROS (camera_info), Kalibr (camchain of one camera) or COLMAP (of one camera)
    write. The `size` of its pictures, [width, height], or `image_width` and `image_height`, restricts
    it to pictures of that size. Keys and models that are not known are refused.

    Raises
    ------
    FileError
        If the file cannot be read or holds no calibrated camera.

    Examples
    --------
    >>> from pathlib import Path
    >>> text = '{"fx": 4700, "fy": 4700, "cx": 3000, "cy": 2000, "size": [6000, 4000]}'
    >>> _ = Path("lens.json").write_text(text)
    >>> lens = bm.read_intrinsics("lens.json")
    >>> lens.size
    (6000, 4000)
    """
    kind, text = Path(path).suffix.lower(), read_document(path, _HINT)
    if kind == ".xml":
        raise FileError(f"{path}: let OpenCV write the calibration as .json or .yml; {_HINT}")
    try:
        if kind == ".txt":
            fields = _from_colmap(text)
        else:
            fields = parse_yaml(text) if kind in (".yml", ".yaml") else parse_json(text, _Keys)
            fields = _without_notes(fields)
    except ValueError as error:
        raise DocumentError(f"{path}: {_HINT}; the file holds no {_WHAT} ({error})") from error
    lens: Intrinsics = checked_json(path, to_json(fields), _LENS, _HINT, _WHAT)
    return lens


_Keys = dict[str, Any]


def _from_colmap(text: str) -> Mapping[str, Any]:
    """The one camera of a cameras.txt; its first pixel's center is (0.5, 0.5)."""
    lines = [line.split() for line in text.splitlines() if line.strip() and line[0] != "#"]
    if len(lines) != 1:
        raise ValueError(f"leave the line of one camera, it has {len(lines)}")
    _, model, width, height, *rest = *lines[0], *(4 - len(lines[0])) * ("",)
    if model not in _COLMAP:
        raise ValueError(f"the model {model!r} cannot be used, only {', '.join(_COLMAP)}")
    names, terms = (part.split() for part in _COLMAP[model])
    if len(rest) != len(names):
        raise ValueError(f"{model} has the parameters {' '.join(names)}, got {len(rest)}")
    values = dict(zip(names, map(float, rest), strict=True)) | {"0": 0.0}
    return {
        **{name: values.get(name, values.get("f")) for name in ("fx", "fy")},
        **{name: values[name] - 0.5 for name in ("cx", "cy")},
        "distortion": [values[name] for name in terms],
        "fisheye": model.endswith("FISHEYE"),
        "size": [int(width), int(height)],
    }


def _without_notes(fields: Any) -> Any:
    """The keys of the lens; those of the one camera in a camchain of Kalibr."""
    if isinstance(fields, dict) and fields and all(_is_camera(*one) for one in fields.items()):
        if len(fields) > 1:
            raise ValueError(f"leave one of its cameras, it has {', '.join(fields)}")
        (fields,) = fields.values()
    if not isinstance(fields, dict):
        return fields
    return {key: value for key, value in fields.items() if key not in _ABOUT}


def _is_camera(name: str, value: Any) -> bool:
    return name.startswith("cam") and name[3:].isdigit() and isinstance(value, dict)


def _data(value: Any) -> Any:
    """The numbers in a row, of nested lists or of a matrix as OpenCV writes it."""
    value = value.get("data") if isinstance(value, dict) else value
    while isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        value = [number for row in value for number in row]
    return value


def _also(*names: str) -> Any:
    """The names of one field in the files of several programs."""
    return Field(validation_alias=AliasChoices(*names))


_Size = Annotated[int, numbers(0, MAX_PX, whole=True)]


@document("width", "height", "do_rectify")
class _Region:
    """The part of the sensor that ROS's pictures show; zeros stand for all of it."""

    x_offset: Literal[0] = 0
    y_offset: Literal[0] = 0


@document()
class _LensFields:
    fx: Annotated[float, numbers(MIN_FOCAL_LENGTH, MAX_PX)] | None = None
    fy: Annotated[float, numbers(MIN_FOCAL_LENGTH, MAX_PX)] | None = None
    cx: Annotated[float, numbers(-MAX_PX, MAX_PX)] | None = None
    cy: Annotated[float, numbers(-MAX_PX, MAX_PX)] | None = None
    distortion: Annotated[
        Array | None,
        numbers(-MAX_PX, MAX_PX, None),
        BeforeValidator(_data),
        _also("distortion", "distortion_coefficients", "distortion_coeffs", "dist_coeffs",
              "distCoeffs", "D", "d"),
    ] = None  # fmt: skip
    fisheye: bool | None = None
    covariance: Annotated[Array, covariance_matrix(MAX_PX**2, None, None)] | None = None
    std: Annotated[Array, numbers(0, MAX_PX, None)] | None = None
    size: Annotated[
        Annotated[Array, numbers(1, MAX_PX, 2, whole=True)] | None, _also("size", "resolution")
    ] = None
    matrix: Annotated[
        Array | None,
        numbers(-MAX_PX, MAX_PX, 9),
        BeforeValidator(_data),
        _also("camera_matrix", "cameraMatrix", "intrinsic_matrix", "K", "k"),
    ] = None
    image_width: Annotated[_Size | None, _also("image_width", "width")] = None
    image_height: Annotated[_Size | None, _also("image_height", "height")] = None
    fisheye_model: Literal[0, 1, False, True] | None = None
    distortion_model: str | None = None
    camera_model: str | None = None
    intrinsics: Annotated[Array, numbers(-MAX_PX, MAX_PX, 4)] | None = None
    binning_x: Literal[0, 1] = 0
    binning_y: Literal[0, 1] = 0
    roi: _Region | None = None


def _lens(fields: _LensFields) -> Intrinsics:
    size = fields.image_width, fields.image_height
    width, height = size if fields.size is None else fields.size.tolist()
    errors = np.zeros((0, 0)) if fields.std is None else np.diag(fields.std**2)
    covariance = errors if fields.covariance is None else fields.covariance
    # OpenCV adds trailing zeros for richer models.
    k = np.zeros(0) if fields.distortion is None else fields.distortion
    k = k[:8] if len(k) in (12, 14) and not k[8:].any() else k
    fisheye = _is_fisheye(fields)
    k = k[:4] if fisheye and not k[4:].any() else k
    fx, fy, cx, cy = _pinhole(fields)
    return Intrinsics(
        fx, fy, cx, cy, k, fisheye, covariance, (width, height) if width and height else None
    )


def _is_fisheye(fields: _LensFields) -> bool:
    """What the keys say of the model; ValueError if they contradict each other, or it is another."""
    if fields.camera_model not in (None, "pinhole"):
        raise ValueError(f"camera_model must be pinhole, got {fields.camera_model!r}")
    model = fields.distortion_model
    if model is not None and model.lower() not in (*_RADIAL, *_FISHEYE):
        known = ", ".join(name for name in (*_RADIAL, *_FISHEYE) if name)
        raise ValueError(f"distortion_model must be one of {known}, got {model!r}")
    if (model or "").lower() in ("none", "") and model is not None and np.any(fields.distortion):
        raise ValueError(f"distortion_model is {model!r}, but there are coefficients")
    said = {
        "fisheye": fields.fisheye,
        "fisheye_model": None if fields.fisheye_model is None else bool(fields.fisheye_model),
        "distortion_model": None if model is None else model.lower() in _FISHEYE,
    }
    stated = {key: value for key, value in said.items() if value is not None}
    if len(set(stated.values())) > 1:
        raise ValueError(f"{' and '.join(stated)} contradict each other")
    return any(stated.values())


def _pinhole(fields: _LensFields) -> Sequence[float]:
    ways = {"a matrix": fields.matrix, "intrinsics": fields.intrinsics, "fx": fields.fx}
    stated = [name for name, value in ways.items() if value is not None]
    if len(stated) > 1:
        raise ValueError(f"give {' or '.join(stated)}, not both")
    if fields.matrix is not None:
        fx, skew, cx, _, fy, cy = fields.matrix[:6].tolist()
        if skew != 0:
            raise ValueError(f"the matrix must not be skewed, got {skew}")
        return fx, fy, cx, cy
    if fields.intrinsics is not None:
        return list(fields.intrinsics.tolist())
    values = {name: getattr(fields, name) for name in _PINHOLE}
    missing = [name for name, value in values.items() if value is None]
    if missing:
        raise ValueError(f"{missing[0]} is missing")
    return list(values.values())


_LENS = Annotated[_LensFields, AfterValidator(_lens)]


def parse_yaml(text: str) -> Any:
    """Mappings, lists, numbers, texts, true, false and null; ValueError for anything else."""
    try:
        documents = list(yaml.load_all(_OPENCV_DIRECTIVE.sub("", text), _Loader))
    except yaml.MarkedYAMLError as error:
        line = "" if error.problem_mark is None else f" in line {error.problem_mark.line + 1}"
        raise ValueError(f"{error.problem or error.context}{line}") from error
    except yaml.YAMLError as error:
        raise ValueError(str(error).splitlines()[0]) from error
    except RecursionError as error:
        raise ValueError("it is nested too deep") from error
    found = [one for one in documents if one is not None]  # messages of ROS end with a separator
    if len(found) > 1:
        raise ValueError(f"leave one of its {len(found)} documents")
    return found[0] if found else None


class _Loader(yaml.SafeLoader):
    """Without aliases, repeated keys and types of tags; with numbers as all programs write them."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        """A node, or a MarkedYAMLError at an alias."""
        if self.check_event(yaml.AliasEvent):
            mark = self.get_event().start_mark  # type: ignore[no-untyped-call]
            raise yaml.MarkedYAMLError(problem="aliases are not supported", problem_mark=mark)
        return super().compose_node(parent, index)


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[str, Any]:
    """The pairs of a mapping; keys are texts."""
    found: dict[str, Any] = {}
    for key_node, value_node in node.value:
        key = str(loader.construct_object(key_node, deep=True))
        if key in found:
            raise yaml.MarkedYAMLError(
                problem=f"it has the key {key} twice", problem_mark=key_node.start_mark
            )
        found[key] = loader.construct_object(value_node, deep=True)
    return found


def _plain(loader: _Loader, node: yaml.Node) -> Any:
    """The value of a node, whatever its tag."""
    if isinstance(node, yaml.MappingNode):
        return _mapping(loader, node)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)  # type: ignore[arg-type]


_Loader.add_constructor("tag:yaml.org,2002:map", _mapping)
for _type in ("binary", "omap", "pairs", "set", "timestamp"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_type}", _plain)
_Loader.add_multi_constructor("", lambda loader, _, node: _plain(loader, node))
_Loader.add_implicit_resolver(_FLOAT, _NUMBER, list("-+0123456789."))
