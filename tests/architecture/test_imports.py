"""Who may import whom."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = {
    path.name: path
    for path in sorted([*ROOT.glob("core/src/*"), *ROOT.glob("plugins/*/src/*")])
    if (path / "__init__.py").is_file()
}
HEAVY = (
    "cv2",
    "cloudpickle",
    "gtsam",
    "loky",
    "matplotlib",
    "networkx",
    "open3d",
    "scipy",
    "shapely",
)
FACES = ("rigcal.cli", "rigcal.report")


@cache
def _modules(package: str) -> dict[str, ast.Module]:
    """Syntax trees by module name; packages by their own name."""
    folder = PACKAGES[package]
    modules = {}
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder.parent).with_suffix("").parts
        name = ".".join(parts).removesuffix(".__init__")
        modules[name] = ast.parse(path.read_text(), str(path))
    return modules


def _is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def _imports(node: ast.AST, when_imported: bool = False) -> Iterator[str]:
    """Names imported below a node; `when_imported`: only those that importing the module runs."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            assert child.level == 0, f"line {child.lineno}: relative import"
            yield from (f"{child.module}.{alias.name}" for alias in child.names)
        elif when_imported and (
            isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)) or _is_type_checking(child)
        ):
            continue
        else:
            yield from _imports(child, when_imported)


def _belongs(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


def test_the_packages_are_found() -> None:
    assert set(PACKAGES) == {
        "rigcal", "rigcal_camera", "rigcal_lrf2d", "rigcal_lrf3d", "rigcal_sim",
    }  # fmt: skip


@pytest.mark.parametrize("package", PACKAGES)
def test_core_imports_no_plugin_and_plugins_no_other_plugin(package: str) -> None:
    foreign = set(PACKAGES) - {"rigcal", package}
    for module, tree in _modules(package).items():
        wrong = [n for n in _imports(tree) if any(_belongs(n, other) for other in foreign)]
        assert not wrong, f"{module} imports {wrong}"


def test_no_room_imports_a_face() -> None:
    for module, tree in _modules("rigcal").items():
        if module == "rigcal" or any(_belongs(module, face) for face in FACES):
            continue
        wrong = [n for n in _imports(tree) if any(_belongs(n, face) for face in FACES)]
        assert not wrong, f"{module} imports {wrong}"


@pytest.mark.parametrize("package", PACKAGES)
def test_modules_import_each_other_without_circles(package: str) -> None:
    modules = _modules(package)
    graph: dict[str, set[str]] = {}
    for module, tree in modules.items():
        names = set(_imports(tree, when_imported=True))
        homes = {n if n in modules else n.rpartition(".")[0] for n in names}
        # A package's __init__ gathers names of the modules below it, which may import the package.
        graph[module] = {h for h in homes & modules.keys() if not _belongs(module, h)}
    TopologicalSorter(graph).prepare()


def test_open3d_is_imported_by_the_3d_laser_only() -> None:
    for package in PACKAGES:
        for module, tree in _modules(package).items():
            if package != "rigcal_lrf3d":
                assert not any(_belongs(n, "open3d") for n in _imports(tree)), module


def test_core_knows_no_sensor_type_by_name() -> None:
    for module, tree in _modules("rigcal").items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Compare):
                words = {c.value for c in ast.walk(node) if isinstance(c, ast.Constant)}
                assert not words & {"camera", "lrf2d", "lrf3d"}, f"{module}:{node.lineno}"


@pytest.mark.parametrize(
    ("arguments", "heavy"),
    [(["--help"], (*HEAVY, "numpy", "pydantic")), (["plugins", "--json"], HEAVY)],
)
def test_start_up_loads_no_heavy_library(arguments: list[str], heavy: tuple[str, ...]) -> None:
    program = """
import json, sys
from rigcal.cli import main
try:
    main(sys.argv[1:])
finally:
    sys.stderr.write(json.dumps(sorted({name.partition(".")[0] for name in sys.modules})))
"""
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=True
    )
    loaded = json.loads(done.stderr)
    assert [name for name in heavy if name in loaded] == []
