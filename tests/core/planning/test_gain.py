"""What board poses would tell, of sensor types that find them, fail at them, or only simulate."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.errors import ConfigError, ObservationError, PluginError
from rigcal.geometry import se3
from rigcal.graph.numbers import NO_NUMBERS
from rigcal.observation import Detection
from rigcal.planning.candidates import draw_candidates
from rigcal.planning.gain import weigh
from rigcal.planning.site import Site
from rigcal.plugin.contract import Effects
from rigcal.rig import T_root_sensors

NAMES = ("gauge", "left", "right")


@pytest.fixture(scope="module")
def site(bench):
    rig = bench.rig(*NAMES)
    return Site.of(rig, bench.registry, T_root_sensors(rig), ())


@pytest.fixture(scope="module")
def poses(site):
    return draw_candidates(site, {"left": 6, "right": 6}, np.random.default_rng(3))


def weighed(site, poses, **changes):
    """By a site whose camera `left` is of a type that differs in so much."""
    kinds = {**site.kinds, "left": replace(site.kinds["left"], **changes)}
    return weigh(replace(site, kinds=kinds), poses, NO_NUMBERS, {}, np.random.default_rng(0))


def test_a_sensor_that_does_not_find_the_board_takes_no_part(site, poses):
    pool = weighed(site, poses, observe=lambda *_: None)
    others = [tuple(s for s in pose.seen_by if s != "left") for pose in poses]
    assert [p.seen_by for p in pool.poses] == [o for o in others if len(o) > 1]
    assert len(pool.poses) < len(poses)
    assert not pool.information[:, 6:12].any()
    assert pool.information[:, 12:].any(axis=(1, 2)).all()


def test_poses_that_one_sensor_finds_tell_nothing(site, poses):
    alone = [replace(pose, seen_by=("left",)) for pose in poses]
    pool = weighed(site, alone)
    assert pool.poses == ()
    assert pool.information.shape == (0, 18, 18)


def test_a_type_that_only_simulates_is_asked_what_its_detector_reports(site, poses):
    """The same noise, the other way round: what it would observe is what it simulates."""
    kind = site.kinds["left"]

    def simulate(T_w_s, scene, config, rng, effects):
        assert isinstance(effects, Effects)
        return kind.observe(se3.inverse(T_w_s) @ scene.T_w_t, config, scene.target, rng)

    def detect(frame, config, target):
        return Detection((frame,))

    only = weighed(site, poses, observe=None, simulate=simulate, detect=detect)
    direct = weighed(site, poses)
    assert [p.seen_by for p in only.poses] == [p.seen_by for p in direct.poses]
    np.testing.assert_array_equal(only.information, direct.information)
    missed = weighed(
        site, poses, observe=None, simulate=simulate, detect=lambda *_: Detection((), "too far")
    )
    assert all("left" not in pose.seen_by for pose in missed.poses)


@pytest.mark.parametrize(
    ("raised", "error", "message"),
    [
        (ZeroDivisionError("by 0"), PluginError, "sensor 'left': type 'eye' fails to simulate what "
         "it sees of a board: ZeroDivisionError: by 0; its plugin needs mending"),
        (ObservationError("sigma_px is 0"), ConfigError, "sensors.left: sigma_px is 0"),
        (PluginError("no hook"), PluginError, "no hook"),
    ],
)  # fmt: skip
def test_a_type_that_fails_is_named(site, poses, raised, error, message):
    def fails(*_):
        raise raised

    with pytest.raises(error) as caught:
        weighed(site, poses, observe=fails)
    assert str(caught.value) == message
