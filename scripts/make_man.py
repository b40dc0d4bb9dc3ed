"""Write docs/blurmatte.1, the manual page, from the help of the program.

Run it from anywhere: python scripts/make_man.py
"""

import re
from pathlib import Path
from typing import Any

import typer

import blurmatte as bm
from blurmatte.cli import app

PAGE = Path(__file__).parents[1] / "docs" / "blurmatte.1"


def page() -> str:
    """The manual page in the language of man."""
    program: Any = typer.main.get_command(app)
    lines = [
        f'.TH BLURMATTE 1 "" "blurmatte {bm.__version__}"',
        ".SH NAME",
        f"blurmatte \\- {escaped(program.help.rstrip('.'))}",
        ".SH SYNOPSIS",
        ".B blurmatte",
        ".I COMMAND",
        "[OPTIONS]",
        ".SH COMMANDS",
    ]
    for name, command in commands(program):
        lines += [f".SS blurmatte {name}", *paragraphs(command.help)]
        for example in (command.epilog or "").splitlines():
            lines += [".PP", f".RS\n.B $ blurmatte {escaped(example)}\n.RE"]
        for parameter in command.params:
            lines += [".TP", f".B {escaped(names(parameter))}", escaped(parameter.help or "")]
    return "\n".join(lines) + "\n"


def commands(group: Any, before: str = "") -> list[tuple[str, Any]]:
    """Every command with its words."""
    found = []
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            found += commands(command, f"{before}{name} ")
        else:
            found.append((before + name, command))
    return found


def names(parameter: Any) -> str:
    """An argument, or an option with its short names and its value."""
    if parameter.param_type_name == "argument":
        return str(parameter.metavar)
    value = f" {parameter.metavar}" if parameter.metavar and not parameter.is_flag else ""
    return ", ".join(sorted(parameter.opts, key=len)) + value


def paragraphs(text: str) -> list[str]:
    """Paragraphs of a help, each in one line."""
    return [
        part for block in text.split("\n\n") for part in (".PP", escaped(" ".join(block.split())))
    ]


def escaped(text: str) -> str:
    """Text as man takes it: hyphens that can be copied, no line that begins as a request."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return re.sub(r"^(?=[.'])", "\\\\&", text)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
