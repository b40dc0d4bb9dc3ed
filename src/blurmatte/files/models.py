"""A ColorModel as JSON: in a file of its own, and in the header of a Solution."""

import json
import math
from pathlib import Path
from typing import Any

from blurmatte.color import ColorModel
from blurmatte.errors import FileError


def model_to_json(model: ColorModel) -> str:
    """Every digit of the model, and its colors for people to read.

    JSON has no infinity: evidence that leaves everything open is null.
    """
    fields = {
        "rank": model.rank,
        "hex": list(model.hex),
        "basis": model.basis.tolist(),
        "covariance": model.covariance.tolist(),
        "evidence": {k: v if math.isfinite(v) else None for k, v in model.evidence.items()},
    }
    lines = (f'  "{name}": {json.dumps(value, allow_nan=False)}' for name, value in fields.items())
    return "{\n" + ",\n".join(lines) + "\n}"


def model_from_json(text: str) -> ColorModel:
    """The model of `model_to_json`.

    Raises
    ------
    KeyError, TypeError, ValueError
        If the text is something else.
    """
    fields: Any = json.loads(text)
    evidence = {k: math.inf if v is None else float(v) for k, v in fields["evidence"].items()}
    return ColorModel(fields["basis"], fields["covariance"], evidence)


def read_color_model(path: str | Path) -> ColorModel:
    """Read a color model that `write` wrote.

    Raises
    ------
    FileError
        If the file cannot be read or holds no color model.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: is no JSON text; {_HINT}") from error
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    try:
        return model_from_json(text)
    except json.JSONDecodeError as error:
        raise FileError(
            f"{path}: is no JSON (line {error.lineno}: {error.msg}); {_HINT}"
        ) from error
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path}: is no color model; {_HINT}") from error


_HINT = "give a file that blurmatte wrote, e.g. with blurmatte color"
