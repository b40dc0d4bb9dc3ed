"""Where the command `blurmatte` begins.

It lies outside of the package, whose imports take most of a second: an interrupt in the middle of them
ends it as quietly as one later does.
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
        # Of the output itself: commands name the files that they could not write.
        print(f"blurmatte: cannot write the answer: {error.strerror}", file=sys.stderr)
        raise SystemExit(2) from None
