"""The command line: one function for each command, a thin skin over the public API."""

from blurmatte.cli import editing as editing
from blurmatte.cli import layers as layers
from blurmatte.cli import motion as motion
from blurmatte.cli import noise as noise
from blurmatte.cli import pictures as pictures
from blurmatte.cli import plates as plates
from blurmatte.cli import response as response
from blurmatte.cli import scenes as scenes
from blurmatte.cli import solving as solving
from blurmatte.cli.program import app as app
