"""JSON: a transfer curve as a table."""

import json
from pathlib import Path
from typing import Any

from blurmatte.errors import FileError
from blurmatte.files.models import mapping_to_json, read_json_text
from blurmatte.radiometry import ResponseFit, Transfer
from blurmatte.radiometry.transfer import TABLE

_HINT = "give a file that blurmatte calibrate response wrote"


def transfer_to_json(curve: Transfer | ResponseFit) -> str:
    """Light of equally spaced code values from 0 to 1, with every digit; of a fit, its errors too."""
    if isinstance(curve, Transfer):
        return mapping_to_json({"name": curve.name, "light": curve.table(TABLE)})
    return mapping_to_json(
        {
            "name": curve.transfer.name,
            "exposure_times": curve.exposure_times,
            "noise": curve.noise,
            "agreement": curve.agreement,
            "seen": curve.seen,
            "channel_difference": curve.channel_difference,
            "channels_agree": int(curve.channels_agree),
            "residuals": curve.residuals,
            "std": curve.std,
            "light": curve.transfer.table(TABLE),
        }
    )


def holds_transfer(path: str | Path) -> bool:
    """Whether a file holds a curve, be it a broken one."""
    try:
        return _is_transfer(json.loads(read_json_text(path, _HINT)))
    except FileError:
        return False


def read_transfer(path: str | Path) -> Transfer:
    """Read a transfer curve that `write` wrote.

    Raises
    ------
    FileError
        If the file cannot be read or holds no transfer curve.
    """
    fields: Any = json.loads(read_json_text(path, _HINT))
    if not _is_transfer(fields):
        model = isinstance(fields, dict) and "basis" in fields
        found = "holds a color model" if model else "is no transfer curve"
        raise FileError(f"{path}: {found}; {_HINT}")
    try:
        return Transfer.from_table(fields["name"], fields["light"])
    except (TypeError, ValueError) as error:
        raise FileError(f"{path}: its curve cannot be used, {error}; {_HINT}") from error


def _is_transfer(fields: object) -> bool:
    return (
        isinstance(fields, dict)
        and isinstance(fields.get("name"), str)
        and isinstance(fields.get("light"), list)
    )
