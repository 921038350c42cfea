"""Every public name has its place in the reference."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import rigcal
import rigcal.plugin
import rigcal.testing

DOCS = Path(__file__).parents[2] / "docs"


def _described(page: str = "*.md") -> list[str]:
    """What the pages ask mkdocstrings for, by its dotted name."""
    texts = [path.read_text(encoding="utf-8") for path in sorted((DOCS / "reference").glob(page))]
    return re.findall(r"^::: ([\w.]+)$", "\n".join(texts), flags=re.M)


def _found(name: str) -> Any:
    """The module or the object of a module that a dotted name means."""
    try:
        return import_module(name)
    except ModuleNotFoundError:
        home, _, last = name.rpartition(".")
        return getattr(import_module(home), last)


@pytest.mark.parametrize(
    ("package", "page"),
    [(rigcal, "api.md"), (rigcal.plugin, "plugin-api.md"), (rigcal.testing, "plugin-*.md")],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_every_public_name_is_in_the_reference(package: Any, page: str) -> None:
    public = {f"{package.__name__}.{name}" for name in package.__all__}
    assert public - set(_described(page)) == set()


def test_every_module_of_the_contract_is_in_the_reference() -> None:
    contract = (DOCS / "plugin-contract.md").read_text(encoding="utf-8")
    (promised,) = re.findall(r"- The modules that plugins build on:(.*?)\n-", contract, flags=re.S)
    described = {name: _found(name) for name in _described()}
    for module in re.findall(r"`(rigcal\.[\w.]+)`", promised):
        assert any(f"{name}.".startswith(f"{module}.") for name in described), module
        for name in getattr(_found(module), "__all__", ()):
            value = getattr(_found(module), name)
            assert any(value is other for other in described.values()), f"{module}.{name}"


def test_nothing_is_described_twice() -> None:
    """Links would not know where to lead."""
    assert len(_described()) == len(set(_described()))
