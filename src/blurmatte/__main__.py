"""`python -m blurmatte` is the command `blurmatte`, also where that is not on the path."""

from blurmatte_command import run

run()
