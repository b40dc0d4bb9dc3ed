"""Entry point of the command `blurmatte`.

It is outside of the package, whose imports take most of a second: an interrupt during the imports
ends the program as quietly as a later one.
"""

import sys


def run() -> None:
    """Run the command line; an interrupt ends it with exit code 130 and no traceback."""
    try:
        from blurmatte.cli import app

        app()
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except OSError as error:
        # An error of stdout: commands report the files that they cannot write.
        print(f"blurmatte: cannot write the answer: {error.strerror}", file=sys.stderr)
        raise SystemExit(2) from None
