"""Checks of the config class, and of how the plugin is found."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from importlib.metadata import entry_points
from types import SimpleNamespace
from typing import Any

import pytest
from pydantic import ValidationError

from rigcal.errors import ConfigError
from rigcal.plugin import Registry, SensorType, hookimpl
from rigcal.rig import parse_rig, rig_schema
from rigcal.testing.stage import Stage

HEAVY = ["cv2", "gtsam", "loky", "matplotlib", "networkx", "open3d", "pandas", "pyapriltags"]
HEAVY += ["scipy", "sklearn", "tensorflow", "torch"]


class ConfigChecks(Stage):
    """The config survives its files and refuses what is wrong; listing the plugin is cheap."""

    @property
    def registry(self) -> Registry:
        """A registry with this sensor type alone."""

        @hookimpl
        def rigcal_sensor_types() -> list[SensorType]:
            return [self.sensor_type]

        return Registry([SimpleNamespace(rigcal_sensor_types=rigcal_sensor_types)])

    def rig(self, **changes: Any) -> dict[str, Any]:
        """A rig of this one sensor, as rig.yaml lays it out; `changes` of the sensor's entry."""
        entry = json.loads(self.config.model_dump_json(exclude_unset=True))
        board = {"type": "checkerboard", "columns": 7, "rows": 5, "square_size_m": 0.1}
        entry |= {"type": self.sensor_type.name, **changes}
        return {
            "version": 1,
            "root": "sensor",
            "targets": {"board": board},
            "sensors": {"sensor": entry},
        }

    def test_config_survives_a_round_trip(self) -> None:
        kind = self.sensor_type.config
        assert isinstance(self.config, kind)
        assert kind.model_validate(self.config.model_dump()) == self.config
        assert kind.model_validate_json(self.config.model_dump_json()) == self.config

    def test_config_is_read_from_a_rig(self) -> None:
        rig = parse_rig(self.rig(), self.registry)
        assert rig.sensors["sensor"] == self.config

    def test_config_is_in_the_schema(self) -> None:
        schema = rig_schema(self.registry)["$defs"][self.sensor_type.config.__name__]
        kind = self.sensor_type.config.__name__
        fields, listed = set(self.sensor_type.config.model_fields), set(schema["properties"])
        assert listed == fields, (
            f"{kind} and its JSON Schema differ in {sorted(listed ^ fields)}: leave schema and "
            "aliases of its fields to pydantic"
        )
        assert schema["properties"]["type"]["const"] == self.sensor_type.name
        assert schema["additionalProperties"] is False, (
            f"{kind} takes keys that it does not know, so that a misspelt one would pass: take its "
            '`extra` out; rigcal.plugin.SensorConfig forbids them ("extra": "forbid")'
        )

    def test_unknown_key_is_refused_with_the_nearest_one(self) -> None:
        with pytest.raises(ConfigError) as caught:
            parse_rig(self.rig(topik="/sensor"), self.registry)
        assert "sensors.sensor.topik: unknown key, did you mean 'topic'?" in str(caught.value)

    def test_numbers_that_are_not_finite_are_refused(self) -> None:
        for name, value in self.config:
            if isinstance(value, float):
                try:
                    self.sensor_type.config.model_validate({**dict(self.config), name: "nan"})
                except ValidationError:
                    continue
                raise AssertionError(
                    f"{name}: nan is taken; rigcal.plugin.SensorConfig refuses it "
                    '("allow_inf_nan": False): leave that as it is'
                )

    def test_type_and_config_can_be_sent_to_another_process(self) -> None:
        kind, config = pickle.loads(pickle.dumps((self.sensor_type, self.config)))
        assert kind == self.sensor_type
        assert config == self.config

    def test_discovery_finds_it_and_imports_nothing_heavy(self) -> None:
        name = self.sensor_type.name
        modules = [entry.module for entry in entry_points(group="rigcal") if self._is_in(entry)]
        assert modules, (
            f"no installed plugin offers '{name}': declare it in pyproject.toml, "
            f'[project.entry-points.rigcal] {name} = "rigcal_{name}", and install the distribution'
        )
        code = f"import sys, {modules[0]}; print([m for m in {HEAVY} if m in sys.modules])"
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert done.stdout.strip() == "[]", "import these inside the functions that need them"

    def _is_in(self, entry: Any) -> bool:
        try:
            offered = entry.load().rigcal_sensor_types()
        except Exception:  # another plugin that is broken, or that offers something else
            return False
        return self.sensor_type in offered
