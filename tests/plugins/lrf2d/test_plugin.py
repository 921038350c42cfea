from __future__ import annotations

import subprocess
import sys

import pytest
from pydantic import ValidationError

from rigcal_lrf2d import LRF2D, Lrf2dConfig, rigcal_sensor_types


def test_the_hook_hands_over_the_sensor_type() -> None:
    assert rigcal_sensor_types() == [LRF2D]
    assert LRF2D.name == "lrf2d"
    assert "sensor_msgs/msg/LaserScan" in LRF2D.message_types
    assert "sensor_msgs/msg/PointCloud2" in LRF2D.message_types
    assert {".pcd", ".ply", ".csv", ".npy"} <= set(LRF2D.message_types)
    assert len(set(LRF2D.message_types)) == len(LRF2D.message_types)


def test_importing_it_imports_nothing_heavy() -> None:
    code = (
        "import sys, rigcal_lrf2d; "
        "print({'scipy', 'cv2', 'gtsam', 'open3d', 'matplotlib'} & set(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


@pytest.mark.parametrize(
    ("keys", "complaint"),
    [
        ({"angle_min_deg": 10, "angle_max_deg": -10}, "above angle_min_deg, by at most 360"),
        ({"angle_min_deg": -200, "angle_max_deg": 200}, "above angle_min_deg, by at most 360"),
        (
            {"angle_min_deg": -10, "angle_max_deg": 10, "angle_step_deg": 30},
            "angle_step_deg 30 leaves one beam in a scan of 20 degrees; make it smaller",
        ),
        ({"range_min_m": 5, "range_max_m": 4}, "range_min_m 5 is not below range_max_m 4"),
        ({"filter": {"ring": [9, 8]}}, "from 9 to 8"),
        ({"sigma_m": 0}, "greater than 0"),
    ],
)
def test_a_config_that_cannot_be_is_refused(keys, complaint: str) -> None:
    with pytest.raises(ValidationError, match=complaint):
        Lrf2dConfig(**keys)


def test_the_config_survives_its_dump() -> None:
    config = Lrf2dConfig(filter={"ring": 8, "intensity": (5, 200)}, angle_step_deg=0.25)
    assert Lrf2dConfig.model_validate(config.model_dump()) == config
    assert Lrf2dConfig.model_validate_json(config.model_dump_json()) == config
