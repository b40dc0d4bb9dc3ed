# SPDX-License-Identifier: GPL-3.0-or-later
"""What blurmatte wrote into a folder: layers, grade, alternatives, path."""

import json
import re
from pathlib import Path

_NUMBERED = re.compile(r"layer\.(\d+)\.exr")


def read_json(path):
    """The content of a JSON file; nothing if it is not there or no JSON."""
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def layers_of(folder):
    """Paths of the layers of a folder by their number; of a single picture the number is None."""
    folder = Path(folder)
    numbered = {
        int(match[1]): path
        for path in folder.glob("layer.*.exr")
        if (match := _NUMBERED.fullmatch(path.name))
    }
    if numbered:
        return dict(sorted(numbered.items()))
    single = folder / "layer.exr"
    return {None: single} if single.is_file() else {}


def sentences_of(folder):
    """Grade, its errors and what else fits, as the command prints them; of a clip its problems."""
    report = read_json(Path(folder) / "report.json")
    said = report.get("in_words") or report.get("problems") or []
    if "grades" in report:
        grades = ", ".join(f"{count} {name}" for name, count in report["grades"].items() if count)
        return [f"layers: {grades}", *said]
    return list(said)


def path_of(folder):
    """Times (0 to 1) and places (x, y), pixels, of the path; nothing if it was not measured."""
    path = read_json(Path(folder) / "motion.json").get("trajectory") or {}
    return path.get("t", []), path.get("xy", [])
