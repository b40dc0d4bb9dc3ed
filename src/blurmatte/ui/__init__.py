"""The page: every command in a browser of the same machine.

A job of the page is a command line. The server (`server`) speaks HTTP and imports no NumPy; two
processes of its own end with it: the worker (`worker`) runs the lines, the viewer (`viewer`) reads
pictures for the page.
"""

from blurmatte.ui.processes import Program as Program
from blurmatte.ui.session import Session as Session
