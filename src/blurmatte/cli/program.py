"""The program that the commands belong to, and how it ends when something goes wrong.

What goes wrong is one line and exit code 2; an answer that rests on an assumption comes with one line
of warning.
"""

import functools
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ParamSpec, TypeVar

import typer
from typer.core import TyperGroup

import blurmatte as bm
from blurmatte.cli.printing import complain, say

if TYPE_CHECKING:
    from rich.progress import Progress

P = ParamSpec("P")
T = TypeVar("T")


class _Program(TyperGroup):
    """Tells what is wrong with the options in one line, like everything else."""

    def make_context(
        self, info_name: str | None, args: list[str], *more: Any, **kwargs: Any
    ) -> Any:
        with _usage_in_one_line():
            if "" in args:  # as a path it would be the folder that one is in
                raise typer.BadParameter(
                    "an argument is empty; a variable of the shell may not be set"
                )
            return super().make_context(info_name, args, *more, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        with _usage_in_one_line():
            return super().invoke(ctx)


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


app = typer.Typer(
    cls=_Program,
    help="Alpha and color of motion-blurred objects over a known background.",
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,  # rich takes longer to import than everything else
    pretty_exceptions_enable=False,
)

calibrate = typer.Typer(help="Measure a camera.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(calibrate, name="calibrate")


def told(command: Callable[P, T]) -> Callable[P, T]:
    """End with one line and exit code 2 instead of a traceback; quietly if interrupted."""

    @functools.wraps(command)
    def told(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return command(*args, **kwargs)
        except KeyboardInterrupt:
            raise typer.Exit(130) from None
        except BrokenPipeError:  # nobody listens any more, which is no mistake
            raise
        except (bm.BlurmatteError, ValueError, TypeError, OSError) as error:
            complain(str(error))
            raise typer.Exit(2) from None

    return told


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


def with_progress(
    things: Iterable[T], doing: str = "solving", count: int | None = None
) -> Iterator[T]:
    """What is done, and for how long, on stderr, if a person is watching; how far, of several things.

    `count` is that of what has no length.
    """
    if count is None:
        assert isinstance(things, Sized)
        count = len(things)
    if count == 0 or not sys.stderr.isatty():
        yield from things
        return
    with bar(several=count > 1) as shown:
        yield from shown.track(things, count, description=doing)


@contextmanager
def waiting(doing: str) -> Iterator[None]:
    """What is done, and for how long, on stderr, if a person is watching."""
    if not sys.stderr.isatty():
        yield
        return
    with bar(several=False) as shown:
        shown.add_task(doing, total=None)
        yield


def bar(several: bool) -> "Progress":
    """What is done, on stderr, and for how long; of several things how far, and it stays then."""
    from rich import progress
    from rich.console import Console

    far = (progress.BarColumn(), progress.TaskProgressColumn(), progress.TimeRemainingColumn())
    return progress.Progress(
        progress.SpinnerColumn(),
        progress.TextColumn("{task.description}"),
        *(far if several else ()),
        progress.TimeElapsedColumn(),
        console=Console(stderr=True, soft_wrap=True),
        transient=not several,
        redirect_stdout=sys.stdout.isatty(),  # what goes to a file must not come here
    )


class NamedError(bm.BlurmatteError):
    """Its message begins with the name of the file, as that of every FileError does."""


@contextmanager
def about(path: Path) -> Iterator[list[str]]:
    """Name the file in whatever goes wrong with it; the list grows by what is warned of."""
    said: list[str] = []
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any) -> None:
            if not issubclass(category, bm.BlurmatteWarning):
                usual(message, category, *place)
                return
            named = issubclass(category, bm.TransferWarning) or str(message).startswith(f"{path}: ")
            line = str(message) if named else f"{path}: {message}"
            if line not in said:
                said.append(line)
                complain(f"warning: {line}")

        warnings.simplefilter("always", bm.BlurmatteWarning)
        warnings.showwarning = show  # type: ignore[assignment]
        try:
            yield said
        except (bm.FileError, NamedError):
            raise
        except MemoryError as error:
            raise NamedError(f"{path}: too large for the memory; reduce it") from error
        except (bm.BlurmatteError, ValueError, TypeError, OSError) as error:
            raise NamedError(f"{path}: {error}") from error
