"""The second truth: scenes of Blender Cycles, rendered, photographed, scored, and made into tables.

    python -m benchmarks.cycles render     needs benchmarks/cycles/blender/install once
    python -m benchmarks.cycles score
    python -m benchmarks.cycles tables

All of it lies in the folder that BLURMATTE_CYCLES names. Every command resumes where it stopped;
`score` can run at the same time as `render`.
"""

import argparse
import os
import sys
from pathlib import Path

from benchmarks.cycles import calibrate, own, rendering, scoring, tables, weights
from benchmarks.cycles.catalog import PARTS
from benchmarks.cycles.methods import methods
from benchmarks.cycles.photograph import photograph
from benchmarks.cycles.pictures import OWN
from benchmarks.table import RESULTS, publish, require_clean_tree

ROOT_VARIABLE = "BLURMATTE_CYCLES"
OWN_SCENES = 6  # of each kind of our own renderer


def arguments() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.cycles",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    made = commands.add_parser("render", help="render and photograph what is missing")
    made.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    made.add_argument("--limit", type=int, help="only so many scenes, of all kinds")
    commands.add_parser("photograph", help="photograph what is rendered, as another run renders")
    ours = commands.add_parser("own", help="write scenes of blurmatte's own renderer")
    ours.add_argument("--count", type=int, default=OWN_SCENES, help="of each kind")
    scored = commands.add_parser("score", help="score what is there and not yet scored")
    scored.add_argument("--parts", nargs="+", choices=(*PARTS, OWN), default=(*PARTS, OWN))
    scored.add_argument("--cameras", nargs="+", help="names of cameras; all if not given")
    scored.add_argument("--methods", nargs="+", choices=list(methods()), default=[scoring.OURS])
    scored.add_argument("--limit", type=float, default=scoring.LIMIT, help="CPU s for a picture")
    scored.add_argument("--processes", type=int, default=2)
    fitted = commands.add_parser("calibrate", help="fit the calibration of alpha's error")
    fitted.add_argument("--limit", type=int, help="only so many pictures, of all kinds")
    fitted.add_argument("--processes", type=int, default=2)
    odds = commands.add_parser("odds", help="fit the odds of hypotheses; before calibrate")
    odds.add_argument("--processes", type=int, default=2)
    weighed = commands.add_parser("weights", help="write docs/results of the weights of hypotheses")
    weighed.add_argument("--processes", type=int, default=2)
    compared = commands.add_parser("check", help="compare the numbers of two journals")
    compared.add_argument("journals", nargs=2, type=Path)
    shown = commands.add_parser("tables", help="write docs/results from the journal")
    shown.add_argument(
        "--sealed", action="store_true", help="with rows over all of the sealed part"
    )
    return parser.parse_args()


def root() -> Path:
    """The folder of pictures.

    Raises
    ------
    SystemExit
        If the variable is not set.
    """
    if not os.environ.get(ROOT_VARIABLE):
        raise SystemExit(f"{ROOT_VARIABLE} is not set; set it to a folder with some 10 GB free")
    return Path(os.environ[ROOT_VARIABLE])


def main() -> int:
    """Run a command."""
    given = arguments()
    match given.command:
        case "render":
            print(f"{rendering.render(root(), tuple(given.parts), given.limit)} pictures written")
        case "photograph":
            print(f"{photograph(root())} pictures written")
        case "own":
            print(f"{own.write_own(root(), given.count)} pictures written")
        case "calibrate":
            print(calibrate.calibrate(root(), given.limit, given.processes))
        case "odds":
            print(weights.write_odds(root(), given.processes))
        case "score":
            journal = scoring.score(
                root(), given.parts, given.cameras, given.methods, given.limit, given.processes
            )
            print(journal)
        case "weights":
            require_clean_tree(RESULTS)
            publish(weights.weigh(root(), given.processes))
        case "check":
            differences = scoring.check(*given.journals)
            print("\n".join(differences) or "the same")
            return 1 if differences else 0
        case "tables":
            tables.publish(root(), given.sealed)
    return 0


if __name__ == "__main__":
    sys.exit(main())
