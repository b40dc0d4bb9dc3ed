"""Many damaged files in several processes, and how often each fault occurs."""

import multiprocessing
import re
import sys
import tempfile
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import seed as seeded
from tests.fuzz.cases import cases
from tests.fuzz.sandbox import Case, Sandbox
from tests.fuzz.seeds import make_seeds

KEPT_PER_FAULT = 3
_NUMBERS = re.compile(r"0x[0-9a-f]+|\d+|'[^']*'|/\S+")


def fuzz(
    count: int, seed: int, workers: int = 1, keep: Path | None = None, pattern: str = "*"
) -> Counter[str]:
    """How often each fault occurred; numbers and names in its text are left out."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        seeds = Path(folder) / "seeds"
        seeds.mkdir()
        make_seeds(seeds)
        shares = [count // workers + (k < count % workers) for k in range(workers)]
        tasks = [(seeds, share, seed + k, keep, pattern) for k, share in enumerate(shares)]
        with multiprocessing.get_context("spawn").Pool(workers) as pool:
            return sum(pool.starmap(_part, tasks), Counter())


def _part(seeds: Path, count: int, seed: int, keep: Path | None, pattern: str) -> Counter[str]:
    faults: Counter[str] = Counter()
    done = 0
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder, Sandbox(seeds, Path(folder)) as box:

        @seeded(seed)
        @settings(
            max_examples=count,
            database=None,
            deadline=None,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(cases(seeds, pattern))
        def look(case: Case) -> None:
            nonlocal done
            done += 1
            fault = box.fault(case)
            if fault:
                name = f"{case.command.split()[0]} {case.seed}: {_NUMBERS.sub('#', fault)[:700]}"
                faults[name] += 1
                if keep is not None and faults[name] <= KEPT_PER_FAULT:
                    _keep(keep, f"{seed}-{done}", case, fault)
            if done % 100 == 0:
                print(f"seed {seed}: {done} of {count}, {faults.total()} faults", file=sys.stderr)

        look()
    return faults


def _keep(folder: Path, name: str, case: Case, fault: str) -> None:
    place = folder / name
    place.mkdir(parents=True, exist_ok=True)
    (place / (case.name or case.seed)).write_bytes(case.content)
    (place / "fault.txt").write_text(f"{case.command}\n{fault}\n")
