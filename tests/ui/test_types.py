"""Door: the types that the page's scripts state, by TypeScript's compiler."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "src" / "blurmatte" / "ui" / "page"
TSC = shutil.which("tsc")


@pytest.mark.skipif(TSC is None, reason="needs tsc on PATH: npm install --global typescript")
def test_the_scripts_of_the_page_have_the_types_that_they_state(tmp_path):
    options = {
        "allowJs": True, "checkJs": True, "noEmit": True, "strict": True, "skipLibCheck": True,
        "target": "es2022", "module": "es2022", "moduleResolution": "bundler",
        "lib": ["es2022", "dom", "dom.iterable"],
    }  # fmt: skip
    project = {"compilerOptions": options, "files": [str(PAGE / "main.js")]}
    (tmp_path / "tsconfig.json").write_text(json.dumps(project))
    command = [TSC, "--project", str(tmp_path), "--pretty", "false"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    faults = [line for line in done.stdout.splitlines() if "page/vendor/" not in line]
    assert [line for line in faults if "error TS" in line] == []
