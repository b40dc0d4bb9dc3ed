"""The command `blurmatte`, also as `python -m blurmatte`."""

import signal
import sys

from blurmatte.interrupts import catch_interrupts, end_now, interrupted


def run() -> None:
    """Run the command line; an interrupt ends it with exit code 130 and no traceback."""
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
