"""The HTML report, as a user reads it."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from rigcal.calibration import Calibration, Rejection, ResidualStatistics, SensorResult
from rigcal.diagnosis.verdict import Axis, SensorVerdict, Verdict
from rigcal.errors import InputError
from rigcal.geometry import se3
from rigcal.observation import Candidate, Detection, Observation, PointGeometry
from rigcal.plugin import SensorConfig, SensorType, hookimpl
from rigcal.plugin.registry import Registry
from rigcal.report import write_report
from rigcal.report.html import render
from rigcal.report.tables import natural_order
from rigcal.rig import Rig, parse_rig


class BeaconConfig(SensorConfig, frozen=True):
    type: Literal["beacon"] = "beacon"


class BeaconPlugin:
    @hookimpl
    def rigcal_sensor_types(self) -> list[SensorType]:
        def detect(frame: Any, config: Any, target: Any) -> Detection:
            return Detection((), reason="never asked here")

        return [SensorType("beacon", BeaconConfig, (".csv",), lambda m, c: m, detect)]


Case = tuple[Calibration, list[Observation], Rig, Registry]


def candidate() -> Candidate:
    return Candidate(PointGeometry(np.zeros(3), np.eye(3), np.zeros(3)), {})


def make_case(names: list[str], exposures: int, reason: str = "3 boards alike") -> Case:
    """A rig where sensor 1 is not used in exposure pose2 and finds nothing in pose3."""
    registry = Registry([BeaconPlugin()])
    board = {"type": "checkerboard", "columns": 5, "rows": 7, "square_size_m": 0.1}
    sensors = {name: {"type": "beacon", "files": f"{name}*.csv"} for name in names}
    rig = parse_rig(
        {"version": 1, "name": "cart", "root": names[0], "targets": {"b": board}}
        | {"sensors": sensors},
        registry,
    )
    rng = np.random.default_rng(0)
    results = {names[0]: SensorResult(names[0], np.eye(4))}
    for name in names[1:]:
        T = se3.transform(
            se3.rotation_from_rpy(np.radians([10, 20, 30])), np.array([0.5, -0.25, 1])
        )
        covariance = np.diag(np.array([1, 2, 3, 4, 5, 6]) * 1e-3) ** 2
        residual = ResidualStatistics("m", 0.0125, 400)
        results[name] = SensorResult(names[0], T, covariance, exposures - 1, 3, residual, 1.25)
    keys = [f"pose{i}" for i in range(exposures)]
    poses = {k: se3.exp(rng.normal(size=6)) for k in keys}
    observations = [
        Observation(name, key, 0, f"{name}_{key}.csv", (candidate(),))
        for name in names
        for key in keys
    ]
    if exposures > 3:
        at = exposures + 3
        lost = observations[at]
        assert (lost.sensor, lost.exposure) == (names[1], "pose3")
        observations[at] = Observation(
            lost.sensor, "pose3", 0, lost.origin, (), "too dark: 4 of 255"
        )
    rejected = (Rejection(names[1], "pose2", "b_pose2.csv", reason),)
    provenance = {"seed": 0, "versions": {"rigcal": "0.1.0"}}
    warnings = ("sensor b: few exposures",)
    calibration = Calibration(names[0], results, poses, rejected, warnings, provenance)
    return calibration, observations, rig, registry


class Cells(HTMLParser):
    """Rows of table cells by their text, and every tag with its attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self._open = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self._open = True

    def handle_endtag(self, tag: str) -> None:
        self._open = self._open and tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        if self._open:
            self.rows[-1][-1] += data


@pytest.fixture(scope="module")
def case() -> Case:
    return make_case(["a", "b"], 5)


@pytest.fixture(scope="module")
def text(case: Case) -> str:
    return render(*case)


def test_transforms_are_in_mm_and_deg_with_their_sigmas(text: str) -> None:
    expected = ["b", "a", "500.00", "-250.00", "1000.00", "10.0000", "20.0000", "30.0000"]
    expected += ["4", "5", "6", "0.057", "0.11", "0.17"]
    assert expected in Cells(text).rows


def test_the_first_sentence_says_how_good_it_is(text: str) -> None:
    assert "2 sensors placed in the frame of a from 5 exposures" in text
    assert "least certain is b, to 6 mm and 0.17 deg (1 sigma)" in text


def test_a_result_that_is_open_says_so_first_with_axis_and_cause(case: Case) -> None:
    calibration, *others = case
    axes = (Axis("open", np.inf), *[Axis("determined", 1e-3)] * 5)
    verdict = Verdict("a", {"b": SensorVerdict(axes, ("all boards <are> parallel",), ("more",))})
    sigmas = {"configured": np.full(6, 2e-3), "estimated": np.full(6, 4e-3)}
    sensors = {"a": calibration.sensors["a"]}
    sensors["b"] = replace(calibration.sensors["b"], sigmas=sigmas)
    page = render(replace(calibration, sensors=sensors, verdict=verdict), *others)
    assert re.search(r'class="headline">The data do not determine the pose of b\. Accepted', page)
    assert "    not determined: rotation about x\n" in page
    assert "because all boards &lt;are&gt; parallel" in page
    numbers = [text for size in ("4", "2", "0.23", "0.11") for text in [size] * 3]
    assert ["b", *numbers, "not determined"] in Cells(page).rows


def test_fit_is_in_millimetres(text: str) -> None:
    assert ["b", "4", "3", "12.5 mm", "400", "1.25"] in Cells(text).rows


def test_what_was_not_used_is_named_with_its_reason(text: str) -> None:
    rows = Cells(text).rows
    assert ["b", "pose2", "b_pose2.csv", "3 boards alike"] in rows
    assert ["b", "pose3", "b_pose3.csv", "too dark: 4 of 255"] in rows
    marks = {row[0]: row[1:] for row in rows if len(row) == 3 and row[0].startswith("pose")}
    assert marks["pose1"] == ["●", "●"]
    assert marks["pose2"] == ["●", "✕"]
    assert marks["pose3"] == ["●", "○"]


def test_warnings_and_provenance_are_shown(text: str) -> None:
    assert "<li>sensor b: few exposures</li>" in text
    assert ["versions.rigcal", "0.1.0"] in Cells(text).rows


def test_text_from_the_data_is_never_markup() -> None:
    page = render(*make_case(["a", "b"], 5, reason="<script>alert(1)</script>"))
    assert "<script>alert" not in page
    assert "&lt;script&gt;" in page


def test_names_in_the_data_of_the_3d_view_cannot_end_their_script() -> None:
    calibration, observations, rig, registry = make_case(["a", "b"], 5)
    poses = {"</script><b>": next(iter(calibration.target_poses.values()))}
    page = render(replace(calibration, target_poses=poses), observations, rig, registry)
    assert "</script><b>" not in page


def test_exposures_in_which_several_targets_stand_are_told_apart() -> None:
    """As `calibrate` names them: each target has a pose of its own in every exposure."""
    one, observations, _, registry = make_case(["a", "b"], 2)
    board = {"type": "checkerboard", "columns": 5, "rows": 7, "square_size_m": 0.1}
    sensors = {
        sensor: {"type": "beacon", "files": f"{sensor}*.csv", "target": target}
        for sensor, target in (("a", "door"), ("b", "wall"))
    }
    targets = {"door": board, "wall": {**board, "square_size_m": 0.2}}
    rig = parse_rig({"version": 1, "root": "a", "targets": targets, "sensors": sensors}, registry)
    poses = {f"pose{i}/{target}": np.eye(4) for i in (0, 1) for target in targets}
    rejected = (Rejection("b", "pose1/wall", "b_pose1.csv", "too far off"),)
    two = replace(one, target_poses=poses, rejected=rejected)
    page = render(two, observations, rig, registry)
    marks = [row for row in Cells(page).rows if len(row) == 3 and row[0].startswith("pose")]
    assert marks == [
        ["pose0/door", "●", ""], ["pose0/wall", "", "●"],
        ["pose1/door", "●", ""], ["pose1/wall", "", "✕"],
    ]  # fmt: skip
    assert ["b", "pose1/wall", "b_pose1.csv", "too far off"] in Cells(page).rows
    widths = {b["name"]: np.ptp(np.array(b["outline"])[:, 0]) for b in scene(page)["boards"]}
    assert widths["pose1/wall"] == pytest.approx(2 * widths["pose1/door"])


def test_the_page_loads_nothing_from_outside(text: str) -> None:
    for tag, attributes in Cells(text).tags:
        assert tag not in {"link", "iframe", "image"}
        for name in ("src", "href", "xlink:href"):
            assert (attributes.get(name) or "#").startswith(("#", "data:"))
    assert not re.search(r"@import|url\((?!#)|https?://(?!www\.w3\.org)", text)


def test_the_figure_names_every_sensor(text: str) -> None:
    (figure,) = re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL)
    assert all(f">{name}</text>" in figure for name in ("a", "b"))


def scene(text: str) -> dict[str, Any]:
    found = re.search(r'id="rig3d-data">(.*?)</script>', text, flags=re.DOTALL)
    assert found
    content: dict[str, Any] = json.loads(found[1])
    return content


def test_the_3d_view_has_all_sensors_and_boards_of_the_solution(case: Case, text: str) -> None:
    calibration = case[0]
    shown = scene(text)
    assert [s["name"] for s in shown["sensors"]] == ["a", "b"]
    np.testing.assert_allclose(shown["sensors"][1]["T"], calibration.T("a", "b")[:3], atol=1e-4)
    assert [b["name"] for b in shown["boards"]] == [f"pose{i}" for i in range(5)]
    middle = np.mean(shown["boards"][0]["outline"], axis=0)
    np.testing.assert_allclose(middle, calibration.target_poses["pose0"][:3, 3], atol=1e-3)


def test_ellipsoids_are_one_sigma_along_the_roots_axes(case: Case, text: str) -> None:
    calibration = case[0]
    first, second = scene(text)["sensors"]
    assert first["ellipsoid"] is None
    axes = np.array(second["ellipsoid"])
    R = calibration.T("a", "b")[:3, :3]
    expected = R @ np.diag([4e-3, 5e-3, 6e-3]) ** 2 @ R.T
    np.testing.assert_allclose(axes @ axes.T, expected, atol=1e-9)


def test_every_sensor_that_contributed_has_a_figure_of_its_errors(text: str) -> None:
    assert set(re.findall(r'alt="Errors of (\w+):', text)) == {"a", "b"}


def test_same_calibration_gives_same_bytes(case: Case, text: str) -> None:
    assert render(*case) == text


def test_a_large_report_stays_under_five_megabytes(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_report(path, *make_case([f"sensor{i}" for i in range(9)], 120))
    assert path.stat().st_size < 5_000_000
    assert path.read_text(encoding="utf-8").endswith("</html>")


def test_a_failed_write_leaves_what_was_there(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    path = tmp_path / "report.html"
    path.write_text("the old one")
    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(InputError, match="cannot be written"):
        write_report(path, *case)
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    assert path.read_text() == "the old one"


def test_a_calibration_without_estimates_can_be_shown() -> None:
    """A truth file has neither covariances nor target poses."""
    calibration, _, rig, registry = make_case(["a", "b"], 5)
    bare = {n: SensorResult(s.parent, s.T_parent_sensor) for n, s in calibration.sensors.items()}
    page = render(Calibration("a", bare), [], rig, registry)
    assert "2 sensors placed in the frame of a." in page
    assert page.count("<svg") == 1


def test_a_sensor_that_the_rig_file_no_longer_has_is_shown_without_its_view() -> None:
    calibration, observations, rig, registry = make_case(["a", "b"], 5)
    more = {**calibration.sensors, "mast": calibration.sensors["b"]}
    page = render(replace(calibration, sensors=more), observations, rig, registry)
    (mast,) = (s for s in scene(page)["sensors"] if s["name"] == "mast")
    assert mast["views"] == []
    np.testing.assert_allclose(mast["T"], calibration.T("a", "b")[:3], atol=1e-4)


def test_exposures_are_listed_in_counting_order() -> None:
    names = ["pose10", "pose2", "pose1", "17", "9"]
    assert sorted(names, key=natural_order) == ["9", "17", "pose1", "pose2", "pose10"]
