"""Damaged files, each with one of the commands that read it, as a strategy of hypothesis."""

import re
from fnmatch import fnmatch
from pathlib import Path

from hypothesis import strategies as st
from tests.fuzz.commands import COMMANDS
from tests.fuzz.mutations import damaged
from tests.fuzz.sandbox import Case

MAX_SCENE_PIXELS = 100_000  # larger scenes take longer than the limit, as they should
_TEXT = ".json", ".toml", ".csv", ".yaml"
_SIZE = re.compile(rb"size = \[(\d{1,20}), (\d{1,20})\]")


def cases(seeds: Path, pattern: str = "*") -> st.SearchStrategy[Case]:
    """Every pair of a command and a seed whose name matches is as likely as another."""
    named = {seed: commands for seed, commands in COMMANDS.items() if fnmatch(seed, pattern)}
    pairs = [(seed, command) for seed, commands in named.items() for command in commands]
    contents = {seed: (seeds / seed).read_bytes() for seed in COMMANDS}
    files = {seed: damaged(content, seed.endswith(_TEXT)) for seed, content in contents.items()}
    return st.sampled_from(pairs).flatmap(
        lambda pair: files[pair[0]].filter(_is_small).map(lambda content: Case(*pair, content))
    )


def _is_small(content: bytes) -> bool:
    size = _SIZE.match(content)
    return size is None or int(size[1]) * int(size[2]) <= MAX_SCENE_PIXELS
