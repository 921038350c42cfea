"""`SensorConformance`: what every sensor plugin is tested by."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from rigcal.testing.config_checks import ConfigChecks
from rigcal.testing.estimate_checks import EstimateChecks
from rigcal.testing.message_checks import MessageChecks
from rigcal.testing.refine_checks import RefineChecks
from rigcal.testing.residual_checks import ResidualChecks
from rigcal.testing.simulator_checks import SimulatorChecks
from rigcal.testing.stillness_checks import StillnessChecks


class SensorConformance(
    ConfigChecks,
    MessageChecks,
    ResidualChecks,
    RefineChecks,
    StillnessChecks,
    SimulatorChecks,
    EstimateChecks,
):
    """Inherit it, name the sensor type and a config, and run pytest:

        from rigcal.testing import SensorConformance
        from rigcal_sonar import SONAR, SonarConfig

        class TestSonar(SensorConformance):
            sensor_type = SONAR
            config = SonarConfig(range_max_m=8.0, sigma_m=0.02)

    The distribution must be installed (`pip install -e .`), and so must `rigcal[testing]`.

    What is checked, file by file of `rigcal.testing`:

    - the config survives YAML and JSON, is in the schema, refuses unknown keys and NaN; listing
      the plugin imports nothing heavy (`config_checks`);
    - messages come back from MCAP and .bag as they went in, with their stamp and frame; empty,
      truncated, misshapen messages and files, and those that hold NaN, are a RecordingError or show
      nothing (`message_checks`);
    - without noise, frame -> detect -> residual is near zero at the true pose; the residual is
      whitened, its Jacobian is its derivative, its order of rows does not matter; the covariance
      that the detector reports is that of its errors; damaged measurements are an ObservationError
      (`residual_checks`);
    - what its config can refine starts where the config says, comes back from `apply`, and moves
      the residual as its derivative claims; so does the bend of the board (`refine_checks`);
    - several frames of a board at rest know more together than one, and no more than is true; a
      second look finds the board near the prediction, and nothing where none is
      (`stillness_checks`);
    - the simulator has the configured noise, is repeatable, agrees with `sees`, and depends on
      relative poses only (`simulator_checks`);
    - a rig of this sensor and a reference is calibrated, and its covariance is true: the
      normalised estimation error squared has its chi-square law (`estimate_checks`).

    What the type does not offer is reported, never passed over: the run lists each part as
    `test_capability[offered: simulate]` or `[not offered: project]`, and a check that needs a
    missing part appears as `test_...[not offered: project]`.

    Boards are shown before the sensor, 1.5 m to 2.6 m away: along x, or along z where the config
    class says `optical = True`. What to set when that does not fit:

    - `distances_m`, or override `poses(rng, count)`, for another field of view;
    - override the property `target` for another board;
    - `noise_free_effects`, or the property `noise_free_config`, for noise that is not in fields
      called `sigma_...`;
    - `tolerance` for a `unit` other than m and px;
    - `raw_sigma = None` for noise that is not one number.

    A type that does not simulate overrides `message` to show a board without a simulator, and is
    then detected and calibrated like the others:

        def message(self, T_s_t, config, rng):
            p = T_s_t[:3, 3] + rng.normal(0.0, config.sigma_m, 3)
            path = self.folder / "0001.csv"
            path.write_text(",".join(map(str, p)))
            return Message(".csv", path, 0, "1", path.name)
    """

    def __init_subclass__(cls, **kwargs: Any) -> None:
        for name in ("sensor_type", "config"):
            if not hasattr(cls, name):
                raise TypeError(f"{cls.__name__}: set `{name}` in the class")
        super().__init_subclass__(**kwargs)

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        """One `test_capability` for each optional part."""
        if metafunc.definition.originalname == "test_capability":
            metafunc.parametrize("capability", list(self._capabilities()))

    def test_capability(self, capability: str) -> None:
        """Lists what the type offers; an optional part is a function or is absent."""
        part = getattr(self.sensor_type, capability)
        assert part is None or callable(part) or isinstance(part, (bool, Mapping))

    def _capabilities(self) -> Iterator[Any]:
        for name, offered in self.offers().items():
            if hasattr(self.sensor_type, name):
                yield pytest.param(name, id=f"{'' if offered else 'not '}offered: {name}")
