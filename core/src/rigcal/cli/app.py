"""`rigcal`: the commands put together, and errors as people read them."""

from __future__ import annotations

import logging
import sys
import traceback
import warnings
from collections.abc import Callable, Sequence
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from rigcal import __version__
from rigcal.cli.calibrate import calibrate
from rigcal.cli.compare import compare
from rigcal.cli.detect import detect
from rigcal.cli.evaluate import evaluate
from rigcal.cli.export import export
from rigcal.cli.fuse import fuse
from rigcal.cli.init import init
from rigcal.cli.new_plugin import new_plugin
from rigcal.cli.plan import plan
from rigcal.cli.plugins import PLUGINS_BRING_MORE, plugins
from rigcal.cli.schema import schema
from rigcal.cli.target import target
from rigcal.cli.validate import validate
from rigcal.cli.view import view
from rigcal.errors import PluginError, RigcalError
from rigcal.plugin.registry import Registry

_COMMANDS: dict[str, Callable[..., Any]] = {
    "init": init,
    "detect": detect,
    "calibrate": calibrate,
    "plan": plan,
    "evaluate": evaluate,
    "compare": compare,
    "validate": validate,
    "export": export,
    "fuse": fuse,
    "view": view,
    "target": target,
    "plugins": plugins,
    "new-plugin": new_plugin,
    "schema": schema,
}
_VERBOSE = ("-v", "--verbose")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit: 0 done, 2 the user can mend it, 1 failure.

    A command may give 1 another meaning: `compare`, that a sensor moved or is missing.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    # Like most programs, take -v before and after the command.
    verbose = any(argument in _VERBOSE for argument in given)
    given = [argument for argument in given if argument not in _VERBOSE]
    _log_to_stderr(logging.DEBUG if verbose else logging.WARNING)
    # loky replaces workers that have grown; nobody can do anything about it, or need to.
    warnings.filterwarnings("ignore", "A worker was restarted", UserWarning)
    try:
        _run(given)
    except RigcalError as error:
        _fail(str(error), error.exit_code, verbose)
    except MemoryError:
        _fail("out of memory", 1, verbose)
    except Exception as error:
        _fail(
            f"unexpected {type(error).__name__}: {error}\n"
            "This is a defect of rigcal or of a plugin; run again with -v to see where",
            1,
            verbose,
        )


def _run(given: list[str]) -> None:
    """The command that is given; PluginError where one of a plugin raises what it should not."""
    registry = Registry.from_entry_points(hooks=("rigcal_commands",))
    app = make_app(registry)
    try:
        app(given)
    except (RigcalError, MemoryError):
        raise
    except Exception as error:
        owner = registry.command_owner(given[0]) if given else None
        if owner is None:
            raise
        raise PluginError(
            f"command '{given[0]}' of plugin {owner} failed with {type(error).__name__}: {error}; "
            "run again with -v to see where"
        ) from error


class _Commands(TyperGroup):
    """A command that is not there may come with a plugin that is not."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args[0] not in self.commands and not args[0].startswith("-"):
            from rigcal.validation import nearest_of

            known = nearest_of(args[0], list(self.commands))
            ctx.fail(f"no command '{args[0]}'{known}; {PLUGINS_BRING_MORE}")
        return super().resolve_command(ctx, args)


def make_app(registry: Registry) -> typer.Typer:
    """The commands of core and of the registry's plugins."""
    app = typer.Typer(
        name="rigcal",
        cls=_Commands,
        help="Extrinsic calibration of any mix of cameras, laser range finders and other sensors.",
        epilog=_left_out(registry),
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        add_completion=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_options)
    for name, run in {**registry.commands, **_COMMANDS}.items():
        app.command(name)(run)
    return app


def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
    verbose: Annotated[
        bool, typer.Option(*_VERBOSE, help="Show log messages, and where an error came from.")
    ] = False,
) -> None:
    """Options that stand before a command."""


def _show_version(on: bool) -> None:
    if on:
        typer.echo(f"rigcal {__version__}")
        raise typer.Exit


def _left_out(registry: Registry) -> str | None:
    """A command that is missed may belong to a plugin that is broken."""
    names = sorted({broken.distribution or broken.name for broken in registry.broken})
    return f"Left out as broken: {', '.join(names)} (see rigcal plugins)." if names else None


def _log_to_stderr(level: int) -> None:
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(levelname)s: %(message)s"))
    log = logging.getLogger("rigcal")
    log.handlers, log.propagate = [handler], False
    log.setLevel(level)


def _fail(message: str, code: int, verbose: bool) -> NoReturn:
    if verbose:
        traceback.print_exc()
    sys.stdout.flush()
    print(f"rigcal: {message}", file=sys.stderr)
    sys.exit(code)
