"""The page of commands, made from the commands themselves."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

_HEAD = "| argument or option | what it is | default |\n|---|---|---|"


def commands() -> dict[str, Any]:
    """The command line's commands by name, those of the installed plugins among them."""
    import typer

    from rigcal import Registry
    from rigcal.cli.app import make_app

    group: Any = typer.main.get_command(make_app(Registry.from_entry_points()))
    found: dict[str, Any] = group.commands
    return found


def commands_page() -> str:
    """Markdown: a heading and a table of arguments and options for each command."""
    parts = []
    for name, command in commands().items():
        text = re.sub(r"\s+", " ", command.help or "").strip()
        table = "\n".join([_HEAD, *_rows(command)])
        parts.append(f"## rigcal {name}\n\n{text}\n\n{table}")
    return "\n\n".join(parts) + "\n"


def _rows(command: Any) -> list[str]:
    rows = []
    for parameter in command.params:
        if parameter.name == "help":
            continue
        if parameter.param_type_name == "argument":
            label = (parameter.metavar or parameter.name.upper()).strip("[]")
        else:
            value = parameter.metavar or ("" if parameter.is_flag else "VALUE")
            names = ", ".join([*parameter.opts, *parameter.secondary_opts])
            # A bar would end the cell.
            label = f"{names} {value}".strip().replace("|", " or ")
        rows.append(f"| `{label}` | {parameter.help or ''} | {_default(parameter)} |")
    return rows


def _default(parameter: Any) -> str:
    if parameter.required:
        return "required"
    # Flags are off, and what may be given several times is not given.
    given = isinstance(parameter.default, int | float | str | Path)
    return f"`{parameter.default}`" if given and not isinstance(parameter.default, bool) else ""
