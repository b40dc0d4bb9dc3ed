"""JSON: a Trajectory."""

import json
from pathlib import Path
from typing import Any

from blurmatte.errors import FileError
from blurmatte.trajectory import Trajectory

_HINT = 'it must be {"xy": [[x, y], …], "t": [0, …, 1]}, pixels and fractions of the exposure'


def path_to_mapping(path: Trajectory, radius: float | None = None) -> dict[str, Any]:
    """What a file of a path holds; `read_path` reads it back from JSON."""
    size = {} if radius is None else {"radius": radius}
    return size | {"t": path.t, "xy": path.xy}


def read_path(path: str | Path) -> tuple[Trajectory, float | None]:
    """Read a path and, if the file tells, the radius of what moved, pixels.

    Raises
    ------
    FileError
        If the file cannot be read or holds no path.
    """
    try:
        fields: Any = json.loads(Path(path).read_text(encoding="utf-8"))
        radius = fields.get("radius")
        return Trajectory(fields["xy"], fields["t"]), None if radius is None else float(radius)
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path}: is no path ({error}); {_HINT}") from error
