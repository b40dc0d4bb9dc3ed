"""Command lines of version 0.1: their current spelling, and that they work."""

import shlex

import pytest
from typer.testing import CliRunner

from blurmatte.cli import app
from blurmatte.cli.old_spellings import modern


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("solve a.png --out o --mask m.png", "solve a.png --out o --region m.png"),
        ("solve a.png --smoothness 2 --solver smooth", "solve a.png --solver smooth:2"),
        ("solve a.png --solver shaded --shaded-plate=s.png", "solve a.png --solver shaded:s.png"),
        ("color a.png --mask m.png", "color a.png --region m.png"),
        ("measure l.exr --points 1,2,3,4,5cm", "measure l.exr --scale 1,2,3,4=5cm"),
        ("measure --json l.exr --radius 2cm", None),
        ("measure l.png", None),
        ("measure l.exr --camera c.json --radius 2cm", "locate l.exr --camera c.json --radius 2cm"),
        (
            "measure l.exr --on-plane 1,2=3,4 --line-time 15us --rotation",
            "locate l.exr --on-plane 1,2=3,4",
        ),
        ("measure a.mp4 --several", "track a.mp4 --several"),
        ("measure 'f*.png' --start 2.5s --step 2", "track 'f*.png' --frames 2.5s::2"),
        ("track a.mp4 --resume", "track a.mp4"),
        ("measure --several a.mp4 --stop=4", "track --several a.mp4 --frames :4"),
        ("plate a.mp4 --start 1 --stop 9 --out p.exr", "plate a.mp4 --out p.exr --frames 1:9"),
        (
            "edit l.exr --image i.png --plate p.png --remove --grow 3 --out o.png",
            "remove l.exr --image i.png --plate p.png --grow 3 --out o.png",
        ),
        ("edit l.exr --over b.png --fade 2 --out o", "compose l.exr --over b.png --fade 2 --out o"),
        ("edit l.exr --plate p.png --fade 2", "compose l.exr --fade 2 --over p.png"),
        ("edit a.mov --fade 2 --start 7", "edit a.mov --fade 2 --first 7"),
        ("edit l.exr --image i.png --plate p.png --fade 2", None),
        ("solve a.png --mask", None),
        ("info a.png", None),
        ("", None),
    ],
)  # fmt: skip
def test_translates_to_the_current_spelling(old, new):
    args, changed = modern(shlex.split(old))
    assert args == shlex.split(old if new is None else new)
    assert changed == (new is not None)


def test_old_spelling_works_and_names_the_new_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["measure", "nowhere.mp4", "--start", "4"])
    warning, refusal = result.stderr.splitlines()
    assert warning == (
        "blurmatte: warning: old spelling, rejected by the next version; write: "
        "blurmatte track nowhere.mp4 --frames 4:"
    )
    assert refusal.startswith("blurmatte: nowhere.mp4: ")
    assert result.exit_code == 2
