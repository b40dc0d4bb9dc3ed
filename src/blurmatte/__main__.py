"""The command `blurmatte`, also as `python -m blurmatte`."""

import codecs
import signal
import sys
from io import TextIOWrapper

from blurmatte.interrupts import catch_interrupts, end_now, interrupted

ASCII = "blurmatte.ascii"  # a handler of letters that the encoding of a stream lacks
_SPELLINGS = {
    "…": "...",
    "±": "+-",
    "°": " deg",
    "²": "2",
    "µ": "u",
    "σ": "sigma",
    "×": "x",
    "—": "-",
}


def spelled(error: UnicodeError) -> tuple[str | bytes, int]:
    """Letters that cannot be encoded, in ASCII: `…` as three points, others as question marks."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letters = error.object[error.start : error.end]
    return "".join(_SPELLINGS.get(letter, "?") for letter in letters), error.end


codecs.register_error(ASCII, spelled)


def run() -> None:
    """Run the command line; an interrupt ends it with exit code 130 and no traceback."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # not every encoding has the letters that are printed
            stream.reconfigure(errors=ASCII)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        catch_interrupts()
    try:
        from blurmatte.cli import app

        app()
    except KeyboardInterrupt:
        end_now()
    except OSError as error:
        if interrupted():
            end_now()
        # An error of stdout: commands report the files that they cannot write.
        print(f"blurmatte: cannot write the answer: {error.strerror}", file=sys.stderr)
        raise SystemExit(2) from None
    except BaseException:
        if interrupted():
            end_now()
        raise


if __name__ == "__main__":
    run()
