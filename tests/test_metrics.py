"""Metrics gathered inside the scan, against the same numbers recomputed from recorded world coordinates."""

from types import SimpleNamespace

import jax
import numpy as np
import pytest

import coopmm_jax as cm
from coopmm_jax.metrics import observer as metrics
from coopmm_jax.metrics.table import LATE, METRICS
from coopmm_jax.parameters import Features, Hardware, Parameters, Structure

STEP = 1e-3
NORMAL_ROW_ONLY = Structure(rows=("contact_normal",))
IDEAL = Hardware()


@pytest.fixture(scope="module")
def runs(simulated_paper):
    """A run that reaches its horizon of 1 s, and one that fails at about 0.4 s, before its late part."""
    singular = cm.simulate(simulated_paper.scenario.with_overrides({"reference.radius": [2.8, 1.0]}))
    assert not singular.ok
    return {"complete": simulated_paper, "failed": singular}


def statistics(name, size):
    """rms, max and final of an error's size at every sample (T,)."""
    return {
        name.replace("*", "rms"): np.sqrt(np.mean(size**2)),
        name.replace("*", "max"): size.max(),
        name.replace("*", "final"): size[-1],
    }


def planar(angle, radius=1.0):
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)


def arm_directions(run):
    """Unit vector e of each arm in the world (T, 2, 2): forward turned by the arm's yaw."""
    return planar(run.q[..., 2] + run.q[..., 3] + np.pi / 2)


def tracking(run):
    error = run.zeta - run.zeta_desired
    sizes = {
        "heading": np.abs(error[..., 0]),
        "position": np.linalg.norm(error[..., 1:], axis=-1),
        "arm": np.abs(run.arm - run.arm_desired),
    }
    norm = np.sqrt(sum(np.sum(size**2, axis=1) for size in sizes.values()))
    expected = {"error_late": norm[late(run)].max() if run.ok else np.nan}
    for name, size in sizes.items():
        expected |= statistics(f"{name}_*_1", size[:, 0]) | statistics(f"{name}_*_2", size[:, 1])
    duration = run.scenario.simulation.duration
    unsettled = run.t[norm > 0.01]
    expected["settling_time"] = min(unsettled[-1] + STEP, duration) if run.ok else np.nan
    return expected


def object_and_tip(run):
    """In the world: object against its guide circle, tip I against the arc's centre C = p2 - Rc e2."""
    surface, reference = run.scenario.coupling, run.scenario.reference
    height = np.full((len(run.t), 1), surface.guide_height)
    desired_object = np.concatenate([planar(reference.rate * run.t, surface.guide_radius), height], axis=1)
    e2, Rc = arm_directions(run)[:, 1], surface.contact_radius
    D = run.tip[:, 0, :2] - (run.tip[:, 1, :2] - Rc * e2)
    seen = np.stack([np.sum(D * e2, axis=1), e2[:, 0] * D[:, 1] - e2[:, 1] * D[:, 0]], axis=1)
    psi = (run.zeta_desired[:, 0, 0] + run.arm_desired[:, 0]) - (run.zeta_desired[:, 1, 0] + run.arm_desired[:, 1])
    return statistics("object_*", np.linalg.norm(run.tip[:, 1] - desired_object, axis=1)) | statistics(
        "relative_tip_*", np.linalg.norm(seen - planar(psi, Rc), axis=1)
    )


def forces(run):
    force, error = run.constraint_force[:, 0], run.constraint_force[:, 0] - run.constraint_force_desired[:, 0]
    late_force, late_error = force[late(run)], error[late(run)]
    return {
        "force_error_rms": np.sqrt(np.mean(error**2)),
        "force_error_rms_late": np.sqrt(np.mean(late_error**2)) if run.ok else np.nan,
        "force_error_final": abs(error[-1]),
        "force_min": force.min(),
        "force_max": force.max(),
        "force_min_late": late_force.min() if run.ok else np.nan,
        "force_max_late": late_force.max() if run.ok else np.nan,
        "contact_loss_fraction": np.mean(force < 0),
        "contact_loss_time": STEP * np.sum(force < 0),
        "contact_loss_depth": max(-force.min(), 0.0),
        **dict.fromkeys(("airborne_time", "gap_max", "impacts", "impact_force_max"), 0.0),  # of a rigid contact
        "internal_force_max": np.abs(run.constraint_force[:, 1:]).max(),
    }


def effort_and_health(run):
    wheels, joints = np.split(np.diff(run.torque[late(run)], axis=0), [2], axis=2)
    return {
        "torque_rms": np.sqrt(np.mean(run.torque**2)),
        "torque_peak": np.abs(run.torque).max(),
        "saturation_fraction": 0.0,
        "torque_variation": np.abs(np.diff(run.torque, axis=0)).sum(),
        "wheel_torque_variation_late": np.abs(wheels).sum() if run.ok else np.nan,
        "joint_torque_variation_late": np.abs(joints).sum() if run.ok else np.nan,
        "persistence": run.scenario.gains.k2 * STEP * len(run.t) * run.scenario.reference.rate**2,
        "c_hat_max": run.c_hat.max(),
        "constraint_residual_max": np.abs(run.constraint_residual).max(),
        "singularity_margin": (determinants(run) / determinants(run)[0]).min(),
    }


def determinants(run):
    """|det| of J_dep's blocks (T, 2) in closed form: 4 l2 l3 |sin a3| times how far the row leans along the arm."""
    surface, e = run.scenario.coupling, arm_directions(run)
    l2, l3 = run.scenario.plant.l2, run.scenario.plant.l3
    D = run.tip[:, 0, :2] - (run.tip[:, 1, :2] - surface.contact_radius * e[:, 1])
    contact = np.sum(D * e[:, 0], axis=1) / surface.contact_radius
    guide = np.sum(run.tip[:, 1, :2] * e[:, 1], axis=1) / surface.guide_radius
    return np.abs(np.stack([contact, guide], axis=1) * 4 * l2 * l3 * np.sin(run.q[:, :, 5]))


def late(run):
    return run.t > 0.75 * run.scenario.simulation.duration - STEP / 2


@pytest.mark.parametrize("name", ["complete", "failed"])
def test_metrics_are_those_of_the_recorded_arrays(runs, name):
    run = runs[name]
    expected = tracking(run) | object_and_tip(run) | forces(run) | effort_and_health(run)
    assert list(run.metrics) == list(METRICS)
    assert set(expected) == set(METRICS)
    for metric, value in expected.items():
        np.testing.assert_allclose(run.metrics[metric], value, rtol=1e-12, atol=1e-15, err_msg=metric)


def test_figures_of_the_paper(simulated_paper):
    """model.md section 5: with `projected` the contact force dips to -93.5 N at 0.09 s, guide forces reach 613 N."""
    measured = simulated_paper.metrics
    assert measured["force_min"] == pytest.approx(-93.5, abs=0.05)
    assert simulated_paper.t[simulated_paper.constraint_force[:, 0].argmin()] == pytest.approx(0.09, abs=0.005)
    assert measured["internal_force_max"] == pytest.approx(613, abs=0.5)


def sample(force, wheel, position_error=0.0, joint=0.0):
    """Signals as far as ``metrics`` reads them, for robots on their references at t = 0 but for z2 of robot I."""
    reference = Parameters().reference
    position = [
        SimpleNamespace(z1=0.0, z2=radius, z3=0.0, a1=centre - swing)
        for radius, centre, swing in zip(reference.radius, reference.arm_centre, reference.arm_swing)
    ]
    position[0].z2 += position_error
    return SimpleNamespace(
        position=position,
        controller=SimpleNamespace(c_hat=(1.0, 2.0)),
        constraint_force=(force,),
        force_error=(force - 15.0,),
        torque=((wheel, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, joint, 0.0)),
        constraint_residual=(-1e-9,),
        tip=(None, (1.7, 0.0, 1.0)),
        contact_point=planar(position[0].a1 - position[1].a1, 0.7),
        determinants=(-2.0,),
        aim=None,
    )


def gathered(samples, duration, structure=NORMAL_ROW_ONLY, hardware=IDEAL, step=1.0):
    """Metrics of hand-made samples, one each step [s], with the contact normal as the only row."""
    still = Parameters()._replace(reference=Parameters().reference._replace(rate=0.0, arm_rate=0.0))
    observer = metrics.observer(structure, still._replace(hardware=hardware), duration, step)
    total = observer.start
    for t, signals in enumerate(samples):
        total = observer.update(total, t * step, signals)
    return metrics.finish(total, duration, step)


def test_errors_of_angles_are_those_of_directions():
    turned = sample(15.0, 1.0)
    turned.position[0].z1 += 2 * np.pi
    turned.position[1].a1 -= 4 * np.pi
    measured = gathered([turned], 1.0)
    assert [measured[name] for name in ("heading_max_1", "heading_max_2", "arm_max_1")] == [0.0] * 3
    assert measured["arm_max_2"] < 1e-14


def test_hand_made_samples():
    """Eight samples over 7 s, late from 5 s on (the sample nearest to 5.25 s), a large position error up to 2 s."""
    forces = [10.0, -5.0, 20.0, -7.0, 15.0, 15.0, 14.0, 18.0]
    wheels = [0.0, 3.0, -1.0, -1.0, 0.0, 2.0, 6.0, 5.0]
    errors = [0.5, 0.2, 0.011, 0.009, 0.0, 0.0, 0.004, 0.003]
    joints = [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 2.0, -1.0]
    measured = gathered(map(sample, forces, wheels, errors, joints), 7.0)
    expected = {
        "settling_time": 3.0,
        "error_late": 0.004,
        "position_max_1": 0.5,
        "position_final_1": 0.003,
        "position_max_2": 0.0,
        "object_max": 0.0,
        "relative_tip_max": 0.0,
        "force_min": -7.0,
        "force_max_late": 18.0,
        "force_error_rms_late": np.sqrt(10 / 3),
        "contact_loss_fraction": 0.25,
        "contact_loss_time": 2.0,
        "contact_loss_depth": 7.0,
        "internal_force_max": 0.0,
        "torque_rms": np.sqrt(82 / 80),
        "torque_variation": 22.0,
        "wheel_torque_variation_late": 5.0,
        "joint_torque_variation_late": 5.0,
        "c_hat_max": 2.0,
        "constraint_residual_max": 1e-9,
        "singularity_margin": 1.0,
    }
    for name, value in expected.items():
        assert measured[name] == pytest.approx(value, rel=1e-12, abs=1e-15), name


@pytest.mark.parametrize(
    ("errors", "settled"), [([0.0, 0.0, 0.0], 0.0), ([0.1, 0.1, 0.0], 2.0), ([0.0, 0.0, 0.1], 2.0)]
)
def test_settling_time_at_its_ends(errors, settled):
    assert gathered((sample(15.0, 0.0, error) for error in errors), 2.0)["settling_time"] == settled


def test_a_tip_that_leaves_and_lands():
    """Nine samples, 5 ms apart: off the surface at three of them, landed twice, the force highest 15 ms after that."""
    gaps = [-1e-4, 2e-3, 1e-3, -2e-4, -1e-4, -3e-4, -4e-4, 5e-4, -1e-4]
    forces = [15.0, 0.0, 0.0, 42.0, 15.0, 78.0, 90.0, 0.0, 15.0]
    samples = [
        SimpleNamespace(**(vars(sample(f, 1.0)) | {"constraint_residual": (gap,)})) for f, gap in zip(forces, gaps)
    ]
    measured = gathered(samples, 0.04, NORMAL_ROW_ONLY._replace(contact="compliant"), step=5e-3)
    expected = {
        "airborne_time": 0.015,
        "contact_loss_fraction": 1 / 3,
        "contact_loss_depth": 0.0,
        "gap_max": 2e-3,
        "impacts": 2.0,
        "impact_force_max": 78.0,
        "constraint_residual_max": 0.0,
    }
    assert {name: float(measured[name]) for name in expected} == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("limits", ["torque_limits", "smooth_limits"])
def test_saturation_is_a_command_beyond_the_limit(limits):
    """Two samples of ten actuators: one wheel and two joints beyond their limits, two joints at theirs."""
    commands = [((9.0, -12.0, 6.0, 5.0, 0.0), (0.0,) * 5), ((0.0,) * 5, (0.0, 7.0, -5.0, 0.0, -5.5))]
    samples = [SimpleNamespace(**vars(sample(15.0, 1.0)), commanded=command) for command in commands]
    hardware = Hardware(wheel_limit=10.0, joint_limit=5.0)
    limited = gathered(
        samples, 1.0, NORMAL_ROW_ONLY._replace(features=Features(force_lag=True, **{limits: True})), hardware
    )
    assert limited["saturation_fraction"] == 3 / 20
    assert gathered(samples, 1.0, hardware=hardware)["saturation_fraction"] == 0.0


def test_failure_at_the_first_sample_leaves_nothing_to_measure():
    measured = gathered([], 2.0)
    assert list(measured) == list(METRICS)
    assert np.isnan(list(measured.values())).all()


def test_failure_before_the_late_window_leaves_late_metrics_and_settling_time_unknown():
    """Two samples of the three that a horizon of 2 s has; late is the last one alone."""
    measured = gathered([sample(15.0, 0.0), sample(15.0, 1.0)], 2.0)
    late = {name for name, metric in METRICS.items() if metric.window == LATE}
    assert {name for name, value in measured.items() if np.isnan(value)} == late | {"settling_time"}


def test_one_late_sample_is_enough_for_late_metrics():
    measured = gathered([sample(15.0, 0.0), sample(15.0, 1.0), sample(14.0, 3.0)], 2.0)
    assert measured["force_min_late"] == measured["force_max_late"] == 14.0
    assert measured["wheel_torque_variation_late"] == 0.0


def test_gradients_are_finite_where_errors_vanish():
    slopes = jax.jit(jax.jacfwd(lambda error, duration: gathered([sample(15.0, 0.0, error)], duration)))
    for error, duration in ((0.0, 0.0), (0.5, 9.0)):  # of which the late window is not reached
        assert all(np.isfinite(slope) for slope in slopes(error, duration).values())
    assert slopes(0.5, 0.0)["position_rms_1"] == pytest.approx(1.0)
