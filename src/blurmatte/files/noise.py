"""JSON: the noise of a camera."""

import json
from pathlib import Path
from typing import Any

from blurmatte.errors import FileError
from blurmatte.radiometry import BLOCKS, NoiseFit, NoiseModel

_PARTS = "gain", "read_std", "relative_std"


def noise_to_mapping(noise: NoiseModel | NoiseFit) -> dict[str, Any]:
    """What a file of noise holds; `read_noise` reads the first three, and the rest is for people."""
    if isinstance(noise, NoiseModel):
        return _parts(noise)
    errors = {f"{name}_std": getattr(noise, f"{name}_std") for name in _PARTS}
    coherence = zip(BLOCKS, noise.coherence.T, strict=True)
    return {
        **_parts(noise.noise),
        "sensor": {**_parts(noise.sensor), **errors},
        "rounding": _parts(noise.rounding),
        "scale": noise.scale,
        "coherence": {f"{size}x{size}": ratio for size, ratio in coherence},
        "changed": noise.changed,
    }


def _parts(noise: NoiseModel) -> dict[str, Any]:
    return {name: getattr(noise, name) for name in _PARTS}


def read_noise(path: str | Path) -> NoiseModel:
    """Read the noise that `write` wrote, of a NoiseModel or a NoiseFit.

    Raises
    ------
    FileError
        If the file cannot be read or holds no noise.
    """
    try:
        fields: Any = json.loads(Path(path).read_text(encoding="utf-8"))
        gain, read_std, relative_std = (_three(fields[name]) for name in _PARTS)
        return NoiseModel(gain, read_std, relative_std)
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: is no JSON text; {_HINT}") from error
    except json.JSONDecodeError as error:
        raise FileError(
            f"{path}: is no JSON (line {error.lineno}: {error.msg}); {_HINT}"
        ) from error
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path}: is no noise of a camera; {_HINT}") from error


def _three(values: Any) -> tuple[float, float, float]:
    red, green, blue = map(float, values)
    return red, green, blue


_HINT = "give a file that blurmatte calibrate noise wrote"
