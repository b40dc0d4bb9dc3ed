"""The program: its commands and their help, the options that all have, and how a command ends."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from importlib import import_module
from itertools import chain
from typing import Annotated, Any, TypeVar, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup
from typer.models import ArgumentInfo

import blurmatte as bm
from blurmatte.cli.console import (
    GENERAL,
    ExitCode,
    Verbosity,
    complain,
    explain_failure,
    flag,
    listening,
    printing,
    say,
    warn,
)
from blurmatte.cli.paths import pictures_of, protecting
from blurmatte.interrupts import interrupted

F = TypeVar("F", bound=Callable[..., None])

ORDER = "blurmatte.order"  # where a context keeps the options in the order in which they were typed
_MAIN = "Arguments and options"
# The commands in the sections of the help, each with its module in this package.
_SECTIONS = {
    "Commands": {
        "solve": "solving",
        "measure": "motion",
        "track": "tracking",
        "edit": "editing",
    },
    "More on color and motion": {
        "find": "pictures",
        "color": "solving",
        "paints": "layers",
        "locate": "motion",
    },
    "Layers and pictures": {
        "sharpen": "layers",
        "remove": "editing",
        "compose": "editing",
        "stack": "layers",
        "show": "pictures",
        "info": "pictures",
        "ui": "page",
    },
    "Before you start": {"plate": "preparing", "calibrate": "preparing"},
    "Scenes with a known truth": {"render": "scenes", "score": "scenes"},
}
_MODULES = {name: module for names in _SECTIONS.values() for name, module in names.items()}

AsJson = Annotated[bool, flag("--json", "Print the answer as JSON.", GENERAL)]
_Quiet = Annotated[bool, flag("--quiet", "No progress, no warnings.", GENERAL, "-q")]
_Verbose = Annotated[bool, flag("--verbose", "Stages with their times; tracebacks.", GENERAL, "-v")]


class Command(TyperCommand):
    """A command whose help begins with an example and shows options in groups."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse; also keep the order of the options, which their values do not show."""
        ctx.meta[ORDER] = [word.split("=")[0] for word in args if word.startswith("--")]
        return super().parse_args(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Examples, usage, text, and a section for each group of options."""
        _format_examples(self.epilog or "", formatter)
        self.format_usage(ctx, formatter)
        self.format_help_text(ctx, formatter)
        groups: dict[str, list[tuple[str, str]]] = {_MAIN: []}
        for param in self.get_params(ctx):
            group = getattr(param, "rich_help_panel", None)
            if param.name == "help":
                group = GENERAL
            if (record := param.get_help_record(ctx)) is not None:
                names, text = record
                if param.param_type_name == "argument":
                    names = names.split(" <")[0]
                groups.setdefault(group or _MAIN, []).append((names, text))
        general = groups.pop(GENERAL)
        for title, records in [*groups.items(), (GENERAL, general)]:
            with formatter.section(title):
                formatter.write_dl(records, col_max=34)


def _format_examples(lines: str, formatter: Any) -> None:
    """Command lines; long ones are continued before an option."""
    for line in lines.splitlines():
        words, shown = re.split(r" (?=-)", f"$ blurmatte {line}"), ""
        for word in words:
            if shown and len(shown.rpartition("\n")[2]) + len(word) > formatter.width - 4:
                shown += " \\\n   "
            shown += f" {word}" if shown else word
        formatter.write(f"{shown}\n")
    formatter.write("\n")


_COMMON = ("--quiet", "-q", "--verbose", "-v")  # options of all commands


def command_first(args: list[str]) -> list[str]:
    """The same with options of all commands, as in `-v solve …`, behind the command."""
    count = next((k for k, word in enumerate(args) if word not in _COMMON), len(args))
    return [*args[count : count + 1], *args[:count], *args[count + 1 :]]


class _Group(TyperGroup):
    """Prints what is wrong with the options as one line, and lists commands in sections."""

    def make_context(
        self, info_name: str | None, args: list[str], *more: Any, **kwargs: Any
    ) -> Any:
        """Parse; an empty argument would be the current folder if it were taken as a path."""
        with _usage_in_one_line():
            if "" in args:
                raise typer.BadParameter("an argument is empty; check the variables of the shell")
            args = command_first(args)
            if args and self._is_of_commands(args[0]):
                raise typer.BadParameter(
                    f"{args[0]} goes behind the command: {info_name} COMMAND {args[0]}"
                )
            return super().make_context(info_name, args, *more, **kwargs)

    def _is_of_commands(self, word: str) -> bool:
        """Whether it is an option that commands have and the group itself has not."""
        own = {*self.context_settings.get("help_option_names", ())}
        own |= {name for one in self.params for name in one.opts}
        return (
            word.startswith("-")  # else no command needs to be imported
            and word not in own
            and any(word in p.opts for one in self.commands.values() for p in one.params)
        )

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was named."""
        with _usage_in_one_line():
            return super().invoke(ctx)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """An example, the commands, and the few options."""
        _format_examples(self.epilog or "", formatter)
        self.format_help_text(ctx, formatter)
        self.format_commands(ctx, formatter)
        records = [one.get_help_record(ctx) for one in self.get_params(ctx)]
        with formatter.section("Options"):
            formatter.write_dl([record for record in records if record is not None])
        formatter.write("\n  COMMAND --help shows examples and the options of a command.\n")

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """One section for each group of commands."""
        for title, names in self.sections().items():
            with formatter.section(title):
                limit = formatter.width - 13
                formatter.write_dl(
                    [(name, self.commands[name].get_short_help_str(limit)) for name in names]
                )

    def sections(self) -> Mapping[str, Iterable[str]]:
        """The sections of the help, each with the names of its commands."""
        return {"Commands": self.commands}


class _Program(_Group):
    """The program, which imports a command when it is needed."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**{**settings, "commands": _Commands()})

    def sections(self) -> Mapping[str, Iterable[str]]:
        """Those of the program."""
        return _SECTIONS


class _Commands(Mapping[str, Any]):
    """All commands by name; the module of one is imported when it is looked up."""

    def __getitem__(self, name: str) -> Any:
        import_module(f"blurmatte.cli.{_MODULES[name]}")
        return _built(name)

    def __iter__(self) -> Iterator[str]:
        return iter(_MODULES)

    def __len__(self) -> int:
        return len(_MODULES)


@cache
def _built(name: str) -> Any:
    """The command of a name, as `command` registered it."""
    return typer.main.get_command(_registered[name])


@contextmanager
def _usage_in_one_line() -> Iterator[None]:
    try:
        yield
    except Exception as error:
        message = error.format_message().strip() if hasattr(error, "format_message") else "\n"
        if "\n" not in message:  # else it is the help, or nothing about usage
            where = getattr(getattr(error, "ctx", None), "command_path", "blurmatte")
            line = f"{message.rstrip('.')}; see {where} --help"
            error.show = lambda file=None: complain(line)  # type: ignore[attr-defined]
        raise


_COMMON_SETTINGS: dict[str, Any] = {
    "no_args_is_help": True,
    "rich_markup_mode": None,  # rich takes longer to import than everything else
    "pretty_exceptions_enable": False,
    "context_settings": {"help_option_names": ["-h", "--help"], "max_content_width": 80},  # columns
}

app = typer.Typer(
    cls=_Program,
    help="Alpha and color of motion-blurred objects over a known background.",
    epilog="solve throw.png --plate empty_room.png -o out/",
    **_COMMON_SETTINGS,
)

calibrate = typer.Typer(
    cls=_Group,
    name="calibrate",
    help="Measure a camera: its noise, or its response curve.",
    epilog="calibrate noise 'still/*.png' -o camera.json",
    add_completion=False,
    **_COMMON_SETTINGS,
)

_registered = {"calibrate": calibrate}


def run_line(
    words: Sequence[str], report: Callable[[str, int, int | None, float | None], None]
) -> int:
    """Run the words of a command line behind `blurmatte` in this process; its exit code.

    Progress goes to `report`: stage, things done, of how many, seconds left.
    """
    with listening(lambda now: report(now.stage, now.done, now.of, now.seconds_left)):
        try:
            app(list(words), prog_name="blurmatte")
        except SystemExit as end:
            return end.code if isinstance(end.code, int) else int(end.code is not None)
    return ExitCode.DONE


def command(*examples: str, group: typer.Typer | None = None) -> Callable[[F], F]:
    """Make a function a command of the program.

    A parameter whose type is a dataclass stands for one option for each of its fields. Every command
    also has --quiet and --verbose. `examples` are shown at the beginning of its help.
    """

    def register(function: F) -> F:
        """The function, after it was added to the group, or to the program."""
        owner = group
        if owner is None:
            owner = typer.Typer(add_completion=False, **_COMMON_SETTINGS)
            _registered[function.__name__] = owner
        help_settings = _COMMON_SETTINGS["context_settings"]
        owner.command(cls=Command, epilog="\n".join(examples), context_settings=help_settings)(
            _with_options(function)
        )
        return function

    return register


def _with_options(function: Callable[..., None]) -> Callable[..., None]:
    """The function with an option for each field, and with one line for each error.

    typer takes options from the signature of a function alone and knows no dataclasses. So the
    signature of the command is put together here from those of its groups: written out, the 16
    commands with groups would have 126 parameters more, `solve` 25 of them in all.
    """
    groups, parameters = _options_of(function)
    arguments = [one.name for one in parameters if _is_row(one.annotation)]

    def run(**values: Any) -> None:
        """Build the groups of options, and call the function."""
        with _ending(values.pop("quiet"), values.pop("verbose")):
            given = dict(values)
            for name, kind in groups.items():
                values[name] = kind(**{f.name: values.pop(f.name) for f in fields(kind)})
            rows = (_texts(given[name]) for name in arguments)
            with protecting(given, pictures_of(chain.from_iterable(rows))) as incomplete:
                for line in incomplete:
                    warn(line)
                function(**values)

    run.__name__, run.__doc__ = function.__name__, function.__doc__
    run.__module__ = function.__module__
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in parameters}
    return run


def _is_row(annotation: Any) -> bool:
    """Whether it is an argument that may be a pattern or a folder; names of scenes are not."""
    kinds = getattr(annotation, "__metadata__", ())
    return any(isinstance(one, ArgumentInfo) and one.metavar != "SCENE" for one in kinds)


def _texts(value: Any) -> list[str]:
    """The texts of an argument; a Path is one file."""
    texts = value if isinstance(value, list) else [value]
    return [text for text in texts if isinstance(text, str)]


def _options_of(function: Callable[..., None]) -> tuple[Mapping[str, Any], list[inspect.Parameter]]:
    """The dataclasses among the parameters of a function, and one parameter for each option."""
    groups, parameters = {}, list[inspect.Parameter]()
    for one in inspect.signature(function, eval_str=True).parameters.values():
        if is_dataclass(one.annotation):
            groups[one.name] = one.annotation
            kinds = get_type_hints(one.annotation, include_extras=True)
            parameters += [_option(f.name, kinds[f.name], f) for f in fields(one.annotation)]
        else:
            parameters.append(_option(one.name, one.annotation, one.default))
    common = _option("quiet", _Quiet, False), _option("verbose", _Verbose, False)
    return groups, [*parameters, *common]


def _option(name: str, kind: Any, default: Any) -> inspect.Parameter:
    """The parameter of an option; a field has both its help and its default."""
    if isinstance(default, Field):
        kind = Annotated[kind, *default.metadata.values()] if default.metadata else kind
        default = inspect.Parameter.empty if default.default is MISSING else default.default
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)


@contextmanager
def _ending(quiet: bool, verbose: bool) -> Iterator[None]:
    """One line and an exit code instead of a traceback."""
    try:
        with printing(Verbosity(quiet, verbose)):
            try:
                yield
            except (BrokenPipeError, typer.Exit, KeyboardInterrupt):
                raise  # nobody listens any more, or it is no error
            except (bm.BlurmatteError, ValueError, TypeError, OSError) as error:
                explain_failure(error)
                complain(_in_words(error))
                raise typer.Exit(ExitCode.REFUSED) from None
            except Exception as error:
                if interrupted():
                    raise typer.Exit(ExitCode.INTERRUPTED) from None
                explain_failure(error)
                complain(
                    f"a defect of blurmatte, {type(error).__name__}: {error}; please report it with "
                    "what the same command prints with -v"
                )
                raise typer.Exit(ExitCode.UNEXPECTED) from None
    except KeyboardInterrupt:
        raise typer.Exit(ExitCode.INTERRUPTED) from None
    except ValueError as error:
        complain(str(error))
        raise typer.Exit(ExitCode.REFUSED) from None


def _in_words(error: Exception) -> str:
    """What was wrong; of a name that the operating system refuses, that name and why."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: check the path ({error.strerror})"
    return str(error)


def _print_version(wanted: bool) -> None:
    if wanted:
        say(f"blurmatte {bm.__version__}")
        raise typer.Exit


@app.callback()
def _blurmatte(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", is_eager=True, callback=_print_version
        ),
    ] = False,
) -> None:
    pass
