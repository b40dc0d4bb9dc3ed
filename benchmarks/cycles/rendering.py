"""Run the scripts in blender/, in an environment that has `bpy`, and photograph what they render."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.cycles.catalog import PARTS, CyclesScene, scenes
from benchmarks.cycles.photograph import photograph, photograph_scene

BLENDER = Path(__file__).parent / "blender"
PYTHON = BLENDER / ".venv" / "bin" / "python"
PYTHON_VARIABLE = "BLURMATTE_BPY"
PHOTOGRAPHS = ("astronaut", "coffee", "chelsea", "rocket")  # of scikit-image, on walls
DONE = "cycles: "  # starts a line that names a rendered scene


def bpy_python() -> Path:
    """The interpreter that has `bpy`.

    Raises
    ------
    FileNotFoundError
        If there is none.
    """
    python = Path(os.environ.get(PYTHON_VARIABLE, PYTHON))
    if not python.exists():
        raise FileNotFoundError(
            f"{python}: no Python with bpy is there; run benchmarks/cycles/blender/install, "
            f"or set {PYTHON_VARIABLE} to one"
        )
    return python


def render(root: Path, parts: tuple[str, ...] = PARTS, limit: int | None = None) -> int:
    """Render what is missing and photograph it; how many pictures were written.

    Scenes of all parts are mixed, so that any beginning of a run holds all kinds. A stopped run resumes
    where it was.
    """
    _write_photographs(root / "textures")
    written = photograph(root)
    jobs = [s.mapping() for s in mixed(parts)[:limit]]
    todo = [job for job in jobs if not (root / "linear" / f"{job['name']}.json").exists()]
    print(f"{len(jobs)} scenes, {len(jobs) - len(todo)} are rendered", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "jobs.json"
        file.write_text(json.dumps(todo), encoding="utf-8")
        command = [str(bpy_python()), str(BLENDER / "render.py"), str(file), str(root)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                if line.startswith(DONE):
                    print(line, end="", flush=True)
                    written += photograph_scene(root, line.split()[4].rstrip(","))
    if process.returncode:
        print(
            f"the renderer ended with {process.returncode}; start again to go on", file=sys.stderr
        )
    return written


def mixed(parts: tuple[str, ...]) -> list[CyclesScene]:
    """Scenes of all parts, the same fraction of each at any time."""
    lists = [list(scenes((part,))) for part in parts]
    placed = [((i + 0.5) / len(one), scene) for one in lists for i, scene in enumerate(one)]
    return [scene for _, scene in sorted(placed, key=lambda pair: pair[0])]


def _write_photographs(folder: Path) -> None:
    """Pictures for walls, from scikit-image."""
    import skimage.data
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    for name in PHOTOGRAPHS:
        path = folder / f"{name}.png"
        if not path.exists():
            Image.fromarray(getattr(skimage.data, name)()[..., :3]).save(path)
