"""Damaged files, each with one of the commands that read it, as a strategy of hypothesis."""

from pathlib import Path

from hypothesis import strategies as st
from tests.fuzz.commands import COMMANDS
from tests.fuzz.mutations import damaged
from tests.fuzz.sandbox import Case

_TEXT = ".json", ".toml", ".csv"


def cases(seeds: Path) -> st.SearchStrategy[Case]:
    """Every pair of a seed and a command is as likely as another."""
    pairs = [(seed, command) for seed, commands in COMMANDS.items() for command in commands]
    contents = {seed: (seeds / seed).read_bytes() for seed in COMMANDS}
    files = {seed: damaged(content, seed.endswith(_TEXT)) for seed, content in contents.items()}
    return st.sampled_from(pairs).flatmap(
        lambda pair: files[pair[0]].map(lambda content: Case(*pair, content))
    )
