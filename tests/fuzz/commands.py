"""Which commands read which seeds.

In a command, FILE is the damaged seed, OUT a new folder, and other names without a slash that are
seeds are those files, undamaged.
"""

from tests.fuzz.seeds import COLOR

_SOLVE = f"--solver pixelwise --color {COLOR} --out OUT/solved"
_QUICK = f"--transfer srgb {_SOLVE}"  # other curves, which take seconds, are not fitted
_PLATE = "--plate plate.png"
_EDITED = "--image image.png --plate plate.png"

PICTURE = (
    "info FILE",
    "info FILE --json",
    "show FILE --out OUT/sheet.png",
    f"solve FILE {_PLATE} {_SOLVE}",
    f"solve image.png --plate FILE {_QUICK}",
    f"solve image.png {_PLATE} --region FILE {_QUICK}",
    f"solve image.png {_PLATE} --occluder FILE {_QUICK}",
    f"color FILE {_PLATE} --color {COLOR} --out OUT/model.json",
    f"calibrate noise FILE {_PLATE} --out OUT/noise.json",
    "calibrate response FILE image8.png plate8.png --exposures 1,2,4 --out OUT/curve.json",
    "compose pixelwise.exr --over FILE --out OUT/over.png",
    "remove pixelwise.exr --image FILE --plate plate.png --out OUT/gone.png",
    "edit pixelwise.exr --image FILE --plate plate.png --fade 0.5 --out OUT/faded.png",
    "stack pixelwise.exr swept.exr --over FILE --out OUT/stack.exr",
    "plate FILE image.png plate.png --out OUT/p.exr",
    f"track FILE image.png image.png {_PLATE} --rate 30 --color {COLOR} --workers 1 --out OUT/t.csv",
)
LAYER = (
    "info FILE",
    "info FILE --json",
    "show FILE --out OUT/sheet.png",
    "measure FILE --json",
    "measure FILE --rotation --diameter 4cm --exposure 1/60 --out OUT/m.csv",
    "locate FILE --camera lens.json --diameter 4cm --exposure 1/60 --out OUT/m.json",
    "edit FILE --fade 0.5 --out OUT/faded.exr",
    f"edit FILE {_EDITED} --recolor #2040ff --out OUT/blue.png",
    f"remove FILE {_EDITED} --out OUT/gone.png",
    "compose FILE --over plate.png --out OUT/over.png",
    "stack FILE swept.exr --out OUT/stack.exr",
    "paints FILE --color #d02020 --color #2040d0 --out OUT/paints",
    "score FILE --truth truth --out OUT/scores.csv",
)
CLIP = (
    "info FILE",
    "plate FILE --out OUT/p.exr",
    f"track FILE {_PLATE} --color {COLOR} --workers 1 --out OUT/t.csv",
    f"track FILE {_PLATE} --color {COLOR} --workers 1 --frames 0.05s:0.1s --out OUT/t.json",
    "compose swept.exr --over FILE --out OUT/over.png",
    "edit FILE --fade 0.5 --out OUT/e.mov",
    "stack FILE --out OUT/stack.exr",
)
_SOLVED = "solve image.png --plate plate.png --solver pixelwise --out OUT/solved"
_SOLVED_WITH = f"{_SOLVED} --transfer srgb"

COMMANDS = {
    **dict.fromkeys(
        ("image.png", "image8.png", "image.jpg", "image.tif", "image16.tif", "image.exr"), PICTURE
    ),
    **dict.fromkeys(("image.dng", "image.bmp"), PICTURE[:5]),
    **dict.fromkeys(("image.webp", "image.avif", "image.heic"), PICTURE[:5] + PICTURE[-5:-3]),
    **dict.fromkeys(("pixelwise.exr", "swept.exr", "swept.png"), LAYER),
    **dict.fromkeys(
        ("clip.mp4", "clip.mov", "clip.mkv", "clip.ts", "joined.ts", "same.mkv", "cut.mkv"), CLIP
    ),
    "model.json": (
        "info FILE",
        f"{_SOLVED_WITH} --color FILE",
        f"color image.png {_PLATE} --color FILE --out OUT/model.json",
        f"track frames {_PLATE} --rate 30 --color FILE --workers 1 --out OUT/t.csv",
    ),
    "noise.json": ("info FILE", f"{_SOLVED_WITH} --color {COLOR} --noise FILE"),
    "curve.json": (
        "info FILE",
        "info image8.png --transfer FILE",
        f"{_SOLVED} --color {COLOR} --transfer FILE",
    ),
    "lens.json": (
        "info FILE",
        "locate swept.exr --camera FILE --diameter 4cm --exposure 1/60 --out OUT/m.csv",
        f"track frames {_PLATE} --rate 30 --color {COLOR} --camera FILE --diameter 4cm --workers 1 "
        "--out OUT/t.csv",
    ),
    "lens.yaml": ("locate swept.exr --camera FILE --diameter 4cm --exposure 1/60 --out OUT/m.csv",),
    "mask.png": (
        f"{_SOLVED_WITH} --color {COLOR} --region FILE",
        f"{_SOLVED_WITH} --color {COLOR} --occluder FILE",
    ),
    "scene.toml": ("render FILE --out OUT/scene", "info FILE"),
    "journal.csv": (
        f"track frames {_PLATE} --rate 30 --color {COLOR} --workers 1 --out OUT/t.csv",
    ),
}
JOURNAL = "t.csv.unfinished"  # the name in OUT under which `track` finds its journal
