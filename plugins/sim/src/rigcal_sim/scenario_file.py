"""The scenario file, and what it says of each sensor, checked against a rig."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from rigcal.document import Document, Problems, read_document
from rigcal.errors import PluginError
from rigcal.plugin import Effects, Registry
from rigcal.rig import Rig
from rigcal.validation import nearest_of
from rigcal_sim.objects import unreadable_textures, with_textures_in
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.timing import ContinuousConfig


def load_scenario(path: Path | str, rig: Rig, registry: Registry) -> ScenarioConfig:
    """The scenario in a YAML file; ConfigError with file, line and key for all that is wrong."""
    document = read_document(path, "a scenario")
    problems = Problems(document)
    scenario = problems.validate(ScenarioConfig, document.data)
    if scenario is not None:
        objects = with_textures_in(Path(path).parent, scenario.objects)
        for index, reason in unreadable_textures(objects):
            problems.add(("objects", index, "texture"), reason)
        scenario = scenario.model_copy(update={"objects": objects})
        _find_effects(problems, scenario, rig, registry)
    problems.raise_if_any()
    assert scenario is not None  # it is None only with a problem noted
    return scenario


def sensor_effects(scenario: ScenarioConfig, rig: Rig, registry: Registry) -> dict[str, Effects]:
    """The effects on every sensor of the rig, validated by the class of its sensor type.

    What `sensors` says of a sensor holds before what `defaults` says of its type; all other
    effects are off. ConfigError for names that the rig does not have, for wrong values, for a
    rate that a continuous recording lacks, and for a jitter that mixes up a sensor's frames.
    """
    problems = Problems(Document("scenario", {}))
    effects = _find_effects(problems, scenario, rig, registry)
    problems.raise_if_any()
    return effects


def scenario_schema(registry: Registry) -> dict[str, Any]:
    """JSON Schema of a scenario file for the sensor types in the registry."""
    effects = {name: kind.effects for name, kind in registry.sensor_types.items()}
    models: list[type[BaseModel]] = [ScenarioConfig, Effects, *effects.values()]
    refs, schema = models_json_schema([(model, "validation") for model in dict.fromkeys(models)])
    of = {model: refs[model, "validation"] for model in models}
    name = of[ScenarioConfig]["$ref"].rpartition("/")[2]
    properties = schema["$defs"][name]["properties"]
    properties["defaults"] |= {
        "properties": {name: of[model] for name, model in effects.items()},
        "additionalProperties": False,
    }
    anything = [of[model] for model in dict.fromkeys(effects.values())]
    properties["sensors"]["additionalProperties"] = {"anyOf": anything or [of[Effects]]}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "rigcal scenario",
        **of[ScenarioConfig],
        **schema,
    }


def _find_effects(
    problems: Problems, scenario: ScenarioConfig, rig: Rig, registry: Registry
) -> dict[str, Effects]:
    defaults = {
        kind: data
        for kind, data in scenario.defaults.items()
        if _are_effects(problems, registry, kind, data)
    }
    for name in scenario.sensors:
        if name not in rig.sensors:
            found = f"the rig has no sensor '{name}'{nearest_of(name, list(rig.sensors))}"
            problems.add(("sensors", name), found)
    effects = {}
    for name, config in rig.sensors.items():
        kind = registry.sensor_type(config.type)
        data = {**defaults.get(config.type, {}), **scenario.sensors.get(name, {})}
        valid = problems.validate(kind.effects, data, ("sensors", name))
        if valid is not None and scenario.defaults.keys() == defaults.keys():
            _check_timing(problems, scenario, name, config.type, valid)
        effects[name] = valid or kind.effects()
    return effects


def _check_timing(
    problems: Problems, scenario: ScenarioConfig, name: str, kind: str, effects: Effects
) -> None:
    """Note a rate that is missing, and a jitter that mixes up the sensor's frames."""
    period_s = scenario.stamps.period_s
    if isinstance(scenario.recording, ContinuousConfig):
        if effects.rate_hz is None:
            text = (
                "a continuous recording needs the rate of every sensor: add `defaults: "
                f"{{{kind}: {{rate_hz: 10.0}}}}` for all of its type, or `sensors: "
                f"{{{name}: {{rate_hz: 10.0}}}}`"
            )
            problems.add(("sensors", name), text)
            return
        period_s = 1 / effects.rate_hz
    jitter_s = scenario.stamps.jitter_of(effects)
    if 2 * jitter_s >= period_s:
        text = f"{jitter_s:g} mixes up frames {period_s:g} s apart; keep it below half of that"
        problems.add(("sensors", name, "jitter_s"), text)


def _are_effects(problems: Problems, registry: Registry, kind: str, data: dict[str, Any]) -> bool:
    """Whether `data` are effects of a sensor type; what is wrong is noted."""
    path = ("defaults", kind)
    try:
        model = registry.sensor_type(kind).effects
    except PluginError as error:
        problems.add(path, str(error))
        return False
    return problems.validate(model, data, path) is not None
