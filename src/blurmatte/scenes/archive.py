"""An archive of scenes for other programs: pictures, truth and checksums, the same bytes each time.

It holds no photographs of others, and neither what can be computed from the rest (the truth with and
without the object) nor sheets. The plate of its truth is that of the camera.
"""

import re
import zipfile
from collections.abc import Iterator, Mapping
from hashlib import sha256
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

from blurmatte.files.atomic import replacing
from blurmatte.scenes.reading import read_shots, scene_names, scene_text
from blurmatte.scenes.saving import save_shot

SCENES = 40
SUMS = "SHA256SUMS"
_OMITTED = "overview.png", "truth/image.exr", "truth/plate.exr"
_SEED_STEP = 1000  # from the seed of a scene to that of its second plate and noise
_TIME = (1980, 1, 1, 0, 0, 0)  # of all files
_ABOUT = """Scenes of moving objects with a known answer, rendered by blurmatte (MIT license).

image.png and plate.png of each folder are the input (.exr: linear light), truth/ is the answer.
Write NAME/layer.png, layer.exr or alpha.png of each scene into a folder of your own, and score it:

    blurmatte score results/ --truth THIS_FOLDER

sha256sum -c SHA256SUMS checks the files. docs/scenes.md of blurmatte describes all of them.
"""


def archive_scenes() -> dict[str, str]:
    """Texts of the scenes of the archive, by their names.

    All built-in scenes of one picture without photographs, and then the first of them again, with
    another plate and other noise, up to forty in all.

    Examples
    --------
    >>> len(bm.scenes.archive_scenes())
    40
    """
    texts = {name: scene_text(name) for name in scene_names()}
    once = {
        name: text for name, text in texts.items() if '"photo"' not in text and "[clip]" not in text
    }
    return once | {
        f"{name}_2": re.sub(r"(?m)^seed = (\d+)", _next_seed, text)
        for name, text in islice(once.items(), SCENES - len(once))
    }


def save_archive(path: str | Path, scenes: Mapping[str, str] | None = None) -> Iterator[str]:
    """Render scenes and write them into one archive, with a list of checksums.

    Parameters
    ----------
    path : str or Path
        The archive, .zip.
    scenes : mapping of str to str, optional
        Names of folders and texts of scene files of one shot; `archive_scenes` by default.

    Yields
    ------
    str
        The name of each scene that is rendered. The archive exists when all are.

    Raises
    ------
    FileError
        If a scene is wrong, or the archive cannot be written.

    Examples
    --------
    >>> for name in bm.scenes.save_archive("scenes.zip"):  # doctest: +SKIP
    ...     print("rendered", name)
    """
    texts = archive_scenes() if scenes is None else scenes
    with (
        TemporaryDirectory(prefix="blurmatte-") as place,
        replacing(Path(path), ".zip") as temporary,
        zipfile.ZipFile(temporary, "w") as archive,
    ):
        sums = [_stored(archive, "README.txt", _ABOUT.encode())]
        for name, text in texts.items():
            file, folder = Path(place) / f"{name}.toml", Path(place) / name
            file.write_text(text, encoding="utf-8")
            save_shot(folder, read_shots(file)[0], text)
            for one in sorted(one for one in folder.rglob("*") if one.is_file()):
                inside = one.relative_to(folder).as_posix()
                if inside not in _OMITTED:
                    sums.append(_stored(archive, f"{name}/{inside}", one.read_bytes()))
            yield name
        _stored(archive, SUMS, "".join(sums).encode())


def _next_seed(found: re.Match[str]) -> str:
    return f"seed = {int(found[1]) + _SEED_STEP}"


def _stored(archive: zipfile.ZipFile, name: str, content: bytes) -> str:
    """Add a file, which is compressed already; its line of checksums."""
    entry = zipfile.ZipInfo(name, _TIME)
    entry.external_attr = 0o644 << 16
    archive.writestr(entry, content)
    return f"{sha256(content).hexdigest()}  {name}\n"
