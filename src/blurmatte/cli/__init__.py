"""The command line: one function for each command, a thin skin over the public API."""

from blurmatte.cli import calibration as calibration
from blurmatte.cli import editing as editing
from blurmatte.cli import layers as layers
from blurmatte.cli import motion as motion
from blurmatte.cli import pictures as pictures
from blurmatte.cli import plates as plates
from blurmatte.cli import scenes as scenes
from blurmatte.cli import sharpening as sharpening
from blurmatte.cli import solving as solving
from blurmatte.cli import tracking as tracking
from blurmatte.cli.app import app as app
