"""Damaged files, each with a command that reads it and a name, as a strategy of hypothesis."""

import os
import re
from fnmatch import fnmatch
from functools import partial
from pathlib import Path

from hypothesis import strategies as st
from tests.fuzz.commands import COMMANDS
from tests.fuzz.mutations import damaged
from tests.fuzz.sandbox import Case

# Of other formats, and such as libraries take for an address, an option or a pattern.
NAMES = (
    *(
        f"a.{name}"
        for name in ("png", "jpg", "tif", "exr", "webp", "heic", "dng", "mp4", "psd", "x")
    ),
    *(
        "throw:1.mp4",
        "http:x.png",
        "concat:a|b.jpg",
        "file:a.exr",
        "a?b=1.png",
        "q%04d.jpg",
        "a*.png",
    ),
    *("-x.png", os.fsdecode(b"th\xffrow.png"), "a"),
)
MAX_SCENE_PIXELS = 100_000  # larger scenes take longer than the limit, as they should
_TEXT = ".json", ".toml", ".csv", ".yaml"
_SIZE = re.compile(rb"size = \[(\d{1,20}), (\d{1,20})\]")


def cases(seeds: Path, pattern: str = "*") -> st.SearchStrategy[Case]:
    """Every pair of a command and a seed whose name matches is as likely as another."""
    named = {seed: commands for seed, commands in COMMANDS.items() if fnmatch(seed, pattern)}
    pairs = [(seed, command) for seed, commands in named.items() for command in commands]
    contents = {seed: (seeds / seed).read_bytes() for seed in COMMANDS}
    files = {seed: damaged(content, seed.endswith(_TEXT)) for seed, content in contents.items()}
    names = st.sampled_from(("",) * len(NAMES) + NAMES)
    return st.sampled_from(pairs).flatmap(
        lambda pair: st.builds(
            partial(Case, *pair),
            files[pair[0]].filter(_is_small),
            st.just("") if pair[0] == "journal.csv" else names,
        )
    )


def _is_small(content: bytes) -> bool:
    size = _SIZE.match(content)
    return size is None or int(size[1]) * int(size[2]) <= MAX_SCENE_PIXELS
