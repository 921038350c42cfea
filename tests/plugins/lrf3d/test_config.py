import pytest
from pydantic import ValidationError

from rigcal_lrf3d import Lrf3dConfig, MultibeamScan, SpinningScan


def test_the_scan_is_chosen_by_its_pattern() -> None:
    spinning = Lrf3dConfig.model_validate({"scan": {"pattern": "spinning_lrf", "tilt_deg": 10}})
    multibeam = Lrf3dConfig.model_validate(
        {"scan": {"pattern": "multibeam", "elevations_deg": [-1, 1]}}
    )
    assert isinstance(spinning.scan, SpinningScan)
    assert isinstance(multibeam.scan, MultibeamScan)
    assert Lrf3dConfig().scan is None


@pytest.mark.parametrize("config", [{"filter": {"ring": 8}}, {"filter": {"ring": [3, 5]}}, {}])
def test_a_config_survives_a_round_trip(config: dict[str, object]) -> None:
    first = Lrf3dConfig.model_validate(config)
    assert Lrf3dConfig.model_validate_json(first.model_dump_json()) == first


@pytest.mark.parametrize(
    ("wrong", "part"),
    [
        ({"scan": {"pattern": "rotating"}}, "spinning_lrf"),
        ({"scan": {"pattern": "multibeam"}}, "elevations_deg"),
        ({"scan": {"pattern": "multibeam", "elevations_deg": []}}, "elevations_deg"),
        ({"scan": {"pattern": "spinning_lrf", "angle_min_deg": 20, "angle_max_deg": 10}}, "below"),
        ({"sigma_m": 0}, "sigma_m"),
        ({"sigma": 0.01}, "sigma"),
        ({"range_min_m": 5, "range_max_m": 1}, "not below"),
    ],
)
def test_a_wrong_config_is_refused(wrong: dict[str, object], part: str) -> None:
    with pytest.raises(ValidationError, match=part):
        Lrf3dConfig.model_validate(wrong)


@pytest.mark.parametrize(
    ("config", "known"),
    [
        ({}, False),
        ({"beam_origin": "sensor"}, True),
        ({"scan": {"pattern": "multibeam", "elevations_deg": [0]}}, True),
        (
            {"scan": {"pattern": "multibeam", "elevations_deg": [0]}, "beam_origin": "unknown"},
            False,
        ),
        ({"scan": {"pattern": "spinning_lrf"}}, True),
        ({"scan": {"pattern": "spinning_lrf", "offset_m": 0.05}}, False),
    ],
)
def test_where_beams_start_follows_from_the_scan(config: dict[str, object], known: bool) -> None:
    assert Lrf3dConfig.model_validate(config).beams_start_at_sensor is known
