"""The command line: one function for each command, a thin skin over the public API."""

from blurmatte.cli.app import app as app
