"""The sections that separate a real loop from the paper's: what they switch on, and what a bad value is told."""

import math

import pytest

from coopmm_jax.cli import main
from coopmm_jax.errors import UserError
from coopmm_jax.parameters import Features, Hardware, Structure
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.scenario.sections import hardware as hardware_schema

SAMPLED = {"loop.control_period": 1e-3}
# feature -> a change of the paper's scenario that switches it on
SWITCHES = {
    "force_lag": {"sensing.force_lag": 0.005},
    "force_bias": {"sensing.force_bias": -0.1},
    "noise": SAMPLED | {"sensing.encoder_noise": 1e-5},
    "torque_limits": {"actuators.wheel_limit": 100.0},
    "smooth_limits": {"actuators.joint_limit": 60.0, "actuators.limit_form": "smooth"},
    "actuator_lag": {"actuators.lag": 0.01},
    "friction": {"actuators.joint_coulomb": 0.2},
    "tip_friction": {"contact.tip_friction": 0.2, "actuators.lag": 0.01},
    "surface_motion": {"contact.surface_amplitude": -0.001},
}


def test_paper_is_ideal():
    for name in ("paper", "paper_full", "uncertain"):
        scenario = load_scenario(name)
        assert scenario.parameters().hardware == Hardware()
        structure = scenario.structure()
        assert (structure.features, structure.substeps, structure.force_delay) == (Features(), 0, 0)


@pytest.mark.parametrize("feature", Features._fields)
def test_each_feature_is_switched_on_by_its_numbers_and_by_nothing_else(feature):
    scenario = Scenario().with_overrides(SWITCHES[feature])
    others = {"actuator_lag"} if feature == "tip_friction" else set()
    assert scenario.structure().features == Features(**dict.fromkeys({feature} | others, True))


def test_numbers_that_only_shape_a_feature_do_not_switch_it_on():
    shapes = {
        "actuators.limit_form": "smooth",
        "actuators.friction_speed": 0.1,
        "contact.slip_speed": 0.1,
        "contact.surface_frequency": 3.0,
        "contact.surface_phase": 1.0,
    }
    assert Scenario().with_overrides(shapes).structure() == Structure()


def test_a_field_that_varies_counts_whatever_its_value():
    sections = hardware_schema.HardwareSections()
    assert sections.features(varied={"sensing.force_lag", "actuators.wheel_coulomb"}) == Features(
        force_lag=True, friction=True
    )


def test_every_number_reaches_the_rollout():
    numbers = {
        "sensing": {
            "force_lag": 0.1,
            "force_bias": 0.2,
            "force_noise": 0.3,
            "encoder_noise": 0.4,
            "velocity_noise": 0.5,
        },
        "actuators": {
            **{"wheel_limit": 1.1, "joint_limit": 1.2, "wheel_viscous": 1.4, "joint_viscous": 1.5},
            **{"wheel_coulomb": 1.6, "joint_coulomb": 1.7, "friction_speed": 1.8},
        },
        "contact": {
            **{"tip_friction": 2.1, "slip_speed": 2.2, "surface_amplitude": 2.3},
            **{"surface_frequency": 2.4, "surface_phase": 2.5, "penetration": 2.6},
        },
    }
    scenario = Scenario().with_overrides(
        SAMPLED
        | numbers
        | {"actuators": numbers["actuators"] | {"lag": 1.3}, "simulation.seed": 3 * 2**16 + 5}
        | {"contact": numbers["contact"] | {"damping": 2.7}}
    )
    expected = {name: value for section in numbers.values() for name, value in section.items()}
    expected |= {"contact_damping": 2.7, "actuator_lag": 1.3, "noise_seed": (3.0, 5.0), "noise_stream": 0.0}
    assert scenario.parameters().hardware._asdict() == expected


@pytest.mark.parametrize(
    ("period", "step", "substeps"), [(0.0, 1e-3, 0), (1e-3, 1e-3, 1), (4e-3, 1e-3, 4), (0.3, 0.1, 3)]
)
def test_substeps_and_samples(period, step, substeps):
    changes = {"loop.control_period": period, "simulation": {"step": step, "duration": 1.2, "record_every": 2}}
    scenario = Scenario().with_overrides(changes)
    assert scenario.structure().substeps == substeps
    assert scenario.steps == round(1.2 / (period or step))


def test_rough_is_sensed_with_all_that_disturbs_it():
    sensed, rough = load_scenario("sensed"), load_scenario("rough")
    everything = Features(*(True,) * len(Features._fields))
    assert rough.structure().features == everything._replace(force_bias=False, smooth_limits=False)
    assert sensed.structure().features == Features(force_lag=True, torque_limits=True)
    hardware = sensed.parameters().hardware
    assert hardware == Hardware(force_lag=0.005, wheel_limit=100.0, joint_limit=60.0)
    assert sensed.structure().substeps == 1
    assert sensed.sample_time == 1e-3
    assert sensed.nominal.scale == 0.8


def test_free_is_sensed_without_guide_and_groove():
    sensed, free = load_scenario("sensed"), load_scenario("free")
    assert free.structure() == sensed.structure()._replace(rows=("contact_normal",))
    gains = free.parameters().gains
    assert (len(gains.K_sigma), len(gains.K_lambda), len(gains.K_I)) == (9, 1, 1)
    assert free.parameters()._replace(gains=None) == sensed.parameters()._replace(gains=None)


BAD = [
    ({"loop.control_period": -1e-3}, "loop.control_period: must be at least 0, was -0.001"),
    (
        {"loop.control_period": 1.5e-3},
        "loop.control_period: must be 0, or a whole number of simulation.step (0.001 s), was 0.0015",
    ),
    (
        {"loop.control_period": 1e-4},
        "loop.control_period: must be 0, or a whole number of simulation.step (0.001 s), was 0.0001",
    ),
    (
        {"loop.control_period": 3e-3, "simulation.record_every": 2},
        "simulation.duration: must be a whole number of loop.control_period * record_every (0.006 s), was 20.0",
    ),
    ({"sensing.force_delay": 1}, "loop.control_period: must be above 0 where sensing.force_delay is used, was 0.0"),
    (
        {"sensing.velocity_noise": 1},
        "loop.control_period: must be above 0 where sensing.velocity_noise is used, was 0.0",
    ),
    (
        SAMPLED | {"sensing.force_noise": 1},
        "sensing.force_lag: must be above 0 (or force_delay) where sensing.force_noise is used, was 0.0",
    ),
    (
        {"contact.tip_friction": 0.1},
        "sensing.force_lag: must be above 0 (or force_delay) where contact.tip_friction is used, was 0.0",
    ),
    ({"sensing.force_delay": 1.5}, "sensing.force_delay: must be a whole number, was 1.5"),
    ({"sensing.force_delay": -1}, "sensing.force_delay: must be at least 0, was -1"),
    ({"sensing.force_lag": math.inf}, "sensing.force_lag: must be finite, was inf"),
    ({"sensing.noise": 1}, "sensing.noise: must be a field of [sensing] (did you mean force_noise?), was unknown"),
    ({"actuators.wheel_limit": 0}, "actuators.wheel_limit: must be greater than 0, was 0"),
    ({"actuators.joint_limit": math.nan}, "actuators.joint_limit: must be greater than 0, was nan"),
    ({"actuators.limit_form": "soft"}, "actuators.limit_form: must be 'hard' or 'smooth', was \"soft\""),
    ({"actuators.lag": "slow"}, 'actuators.lag: must be a number, was "slow"'),
    ({"contact.slip_speed": 0}, "contact.slip_speed: must be greater than 0, was 0"),
    ({"contact.surface_amplitude": math.inf}, "contact.surface_amplitude: must be finite, was inf"),
]


@pytest.mark.parametrize(("changes", "message"), BAD, ids=[message.split(",")[0] for _, message in BAD])
def test_bad_values_are_told_in_one_line(changes, message):
    with pytest.raises(UserError) as told:
        Scenario().with_overrides(changes)
    assert str(told.value) == message


@pytest.mark.parametrize("option", [["--loop.control-period", "0.0015"], ["--sensing.force-delay", "1.5"]])
def test_command_line_says_so_with_exit_code_two(option, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "sensed", *option]) == 2
    field = option[0].removeprefix("--").replace("-", "_")
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith(f"coopmm: error: {field}: must be ")
    assert told.err.count("\n") == 1
    assert not list(tmp_path.iterdir())
