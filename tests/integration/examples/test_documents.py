"""What the README and the examples show can be used as it stands."""

import re
import textwrap
from pathlib import Path

import pytest
import yaml

import rigcal

ROOT = Path(__file__).parents[3]
REAL_RIGS = {
    "acfr_vlp16": ["cam", "lidar"],
    "acfr_ring8": ["cam", "scan"],
    "acfr_three": ["cam", "lidar", "scan"],
    "opencv_stereo": ["left", "right"],
    "caliscope": ["cam0", "cam1", "cam2", "cam3"],
}
PAGES = sorted(
    p for p in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/**/*.md"))
)


@pytest.fixture(scope="module")
def registry() -> rigcal.Registry:
    return rigcal.Registry.from_entry_points()


@pytest.mark.parametrize("name", REAL_RIGS)
def test_rig_files_of_public_recordings_are_valid(name: str, registry: rigcal.Registry) -> None:
    rig = rigcal.load_rig(ROOT / "examples" / "real" / f"{name}.yaml", registry)
    assert rig.name == name
    assert list(rig.sensors) == REAL_RIGS[name]


def test_the_readme_rig_is_valid(registry: rigcal.Registry) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    match = re.search(r"^ +version: 1\n(?: +.*\n)+", text, flags=re.MULTILINE)
    assert match is not None
    rig = rigcal.parse_rig(yaml.safe_load(textwrap.dedent(match.group())), registry)
    assert list(rig.sensors) == ["cam0", "front", "lidar"]


def test_the_readme_imports_exist() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    match = re.search(r"from rigcal import (.+)", text)
    assert match is not None
    assert {name.strip() for name in match.group(1).split(",")} <= set(rigcal.__all__)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_to_files_of_the_repository(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        if not link.startswith(("https://", "#")):
            target = (page.parent / link.partition("#")[0]).resolve()
            assert target.exists(), f"{page.name} links to {link}"
            assert target.is_relative_to(ROOT), f"{page.name} links outside the repository: {link}"
