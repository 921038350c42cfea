"""Every code block of the documentation runs, as its page says."""

from __future__ import annotations

import importlib.util
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import rigcal
from rigcal.calibration import Calibration, SensorResult
from rigcal.geometry import se3
from rigcal_sim.dataset import simulate
from rigcal_sim.features import observe_boards
from rigcal_sim.scenario import ScenarioConfig

ROOT = Path(__file__).parents[2]
GUIDE = sorted(p.name for p in (ROOT / "docs" / "guide").glob("*.md"))
ELSEWHERE = {
    "embed.md": "test_embedding_pages.py",
    "nightly-check.md": "test_embedding_pages.py",
    "other-doors.md": "test_other_doors.py",
    "ros2-node.md": "test_embedding_pages.py",
    "write-a-plugin.md": "test_write_a_plugin.py",
}
CAMERA = {
    "type": "camera", "width_px": 640, "height_px": 480, "focal_px": [500.0, 500.0],
    "principal_px": [319.5, 239.5],
}  # fmt: skip
RIG = {
    "version": 1,
    "root": "lidar",
    "targets": {"board": {"type": "checkerboard", "columns": 8, "rows": 5, "square_size_m": 0.1}},
    "sensors": {"lidar": {"type": "lrf3d"}, "cam0": CAMERA, "cam1": CAMERA},
}


@pytest.fixture
def supplied(desk: Any, seen: Path) -> Any:
    """A desk with a rig, what it saw, and calibrations of it, which some pages begin from."""
    T = se3.exp(np.array([0.0, 0.3, 0.1, 0.1, 0.0, 0.2]))
    sensors = {
        "lidar": SensorResult("lidar", np.eye(4)),
        "cam0": SensorResult("lidar", T, 1e-6 * np.eye(6)),
        "cam1": SensorResult("lidar", se3.inverse(T), 1e-6 * np.eye(6)),
    }
    (desk.folder / "rig.yaml").write_text(yaml.safe_dump(RIG))
    for name in ("first", "second", "result"):
        path = desk.folder / name / "calibration.yaml"
        rigcal.save_calibration(path, Calibration("lidar", sensors))
    shutil.copy(seen, desk.folder / "first" / "observations.npz")
    (desk.folder / "examples").symlink_to(ROOT / "examples")
    return desk


@pytest.fixture
def driven(supplied: Any) -> Any:
    """A desk that has a recording of the rig, and what other tools know of it."""
    registry = rigcal.Registry.from_entry_points()
    rig, folder = _placed_rig(registry), supplied.folder
    scenario = ScenarioConfig(board={"mode": "cover", "poses": 1})
    simulate(rig, registry, scenario, 0, folder, jobs=1)
    (folder / "recording.mcap").rename(folder / "drive.mcap")
    known = rigcal.load_calibration(folder / "truth.yaml")
    rigcal.write_export(folder / "robot.urdf", known, registry, "urdf", rig)
    rigcal.write_export(folder / "lenses", known, registry, "opencv", rig)
    (folder / "lenses" / "cam0.yaml").rename(folder / "front_left.yml")
    return supplied


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the rig's sensors see of 15 boards, looking to one side from a few centimetres apart."""
    path = tmp_path_factory.mktemp("seen") / "observations.npz"
    registry = rigcal.Registry.from_entry_points()
    rig = _placed_rig(registry)
    scenario = ScenarioConfig(board={"mode": "cover", "poses": 15})
    rigcal.save_observations(path, observe_boards(rig, registry, scenario, seed=0).observations)
    return path


def _placed_rig(registry: rigcal.Registry) -> rigcal.Rig:
    """The rig with what a simulation wants to know."""
    scan = {"pattern": "multibeam", "elevations_deg": [*range(-20, 21, 4)], "azimuth_step_deg": 1}
    added: dict[str, Any] = {"lidar": {"scan": scan, "topic": "/lidar/points"}}
    for i in range(2):
        ahead = {"x": -0.5, "y": 0.5, "z": -0.5, "w": 0.5}
        pose = {"parent": "lidar", "translation_m": [0.0, 0.1 * i, 0.1], "rotation": ahead}
        added[f"cam{i}"] = {"pose": pose, "topic": f"/cam{i}/image_raw"}
    sensors = {name: config | added[name] for name, config in RIG["sensors"].items()}
    return rigcal.parse_rig(RIG | {"sensors": sensors}, registry)


@pytest.mark.parametrize(
    "name", [name for name in GUIDE if name not in ELSEWHERE and name != "other-tools.md"]
)
def test_the_page_can_be_followed(supplied: Any, page: Any, name: str) -> None:
    supplied.follow(page(f"guide/{name}"))


def test_the_page_of_other_tools_can_be_followed(driven: Any, page: Any) -> None:
    driven.follow(page("guide/other-tools.md"))
    text = (driven.folder / "drive.yaml").read_text()
    assert (
        "# width_px, height_px, model, focal_px, principal_px, distortion from front_left.yml"
        in text
    )
    rig = yaml.safe_load(text)
    assert rig["root"] == "lidar"
    assert rig["sensors"]["cam0"]["focal_px"] == CAMERA["focal_px"]
    assert rig["sensors"]["cam1"]["pose"]["translation_m"] == pytest.approx([0.0, 0.1, 0.1])


@pytest.mark.parametrize(("name", "test"), ELSEWHERE.items())
def test_other_pages_have_tests_of_their_own(name: str, test: str) -> None:
    assert f"guide/{name}" in (Path(__file__).parent / test).read_text()


def test_no_code_hides_outside_the_guide() -> None:
    """Elsewhere code would not be run: text, and what a shell cannot do without."""
    for path in (ROOT / "docs").rglob("*.md"):
        if path.parent.name != "guide":
            languages = set(re.findall(r"^```(\w+)", path.read_text(), flags=re.M))
            assert languages <= {"text"}, path


PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "examples/real/README.md")),
    # It brings a command of its own, and is run whole.
    *sorted(set((ROOT / "docs").rglob("*.md")) - {ROOT / "docs" / "guide" / "other-doors.md"}),
]
_BLOCKS = re.compile(r"^```\w*\n(.*?)^```$|((?:^ {4,}.*\n)+)", re.M | re.S)
_SPANS = re.compile(r"`(rigcal [^`]+)`")
_COMMAND = re.compile(r"^(?:uv run )?rigcal ([a-z][a-z-]*)\b(.*)")


def _commands_of(page: Path) -> list[tuple[str, list[str]]]:
    """Command and options of every line of code that calls rigcal, in a block or within text."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    blocks = [
        line.strip() for found in _BLOCKS.findall(text) for line in "".join(found).split("\n")
    ]
    lines = blocks + [" ".join(span.split()) for span in _SPANS.findall(text)]
    found = [match for line in lines if (match := _COMMAND.match(line.partition(" #")[0]))]
    return [(m[1], re.findall(r"(?<= )--?[a-z][a-z-]*", m[2])) for m in found]


@pytest.mark.parametrize("page_", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_commands_and_options_that_a_page_names_exist(commands_page: Any, page_: Path) -> None:
    """Also where they are not run, because they take minutes or need outside data."""
    commands = commands_page.commands()
    for name, options in _commands_of(page_):
        assert name in commands, name
        known = {o for p in commands[name].params for o in (*p.opts, *p.secondary_opts)}
        assert set(options) <= known | {"--help", "-v"}, name


def test_commands_are_found_wherever_they_stand() -> None:
    in_blocks = {name for name, _ in _commands_of(ROOT / "docs" / "guide" / "recording.md")}
    assert in_blocks == {"simulate", "calibrate", "evaluate"}
    assert ("export", ["--format", "--out"]) in _commands_of(ROOT / "README.md")


@pytest.fixture(scope="module")
def commands_page() -> Any:
    spec = importlib.util.spec_from_file_location("page", ROOT / "docs" / "commands_page.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_command_and_option_is_described(commands_page: Any) -> None:
    text = commands_page.commands_page()
    for name, command in commands_page.commands().items():
        assert f"## rigcal {name}\n" in text
        assert len(command.help or "") > 20, name
        for parameter in command.params:
            assert len(parameter.help or "") > 8, f"{name}: {parameter.name}"
            for option in parameter.opts if parameter.param_type_name == "option" else ():
                assert option in text or option == "--help", f"{name}: {option}"
