# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the archive of the add-on: python integrations/blender/build.py [FOLDER].

The same files give the same bytes.
"""

import sys
import tomllib
import zipfile
from pathlib import Path

ADDON = Path(__file__).parent / "addon"
_TIME = (1980, 1, 1, 0, 0, 0)  # of all files


def build(folder):
    """Write the archive into a folder; its path."""
    manifest = tomllib.loads((ADDON / "blender_manifest.toml").read_text(encoding="utf-8"))
    target = Path(folder) / f"{manifest['id']}-{manifest['version']}.zip"
    target.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(path for path in ADDON.iterdir() if path.is_file()):
            entry = zipfile.ZipInfo(path.name, _TIME)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, path.read_bytes())
    return target


if __name__ == "__main__":
    print(build(sys.argv[1] if len(sys.argv) > 1 else "."))
