"""The sections of a scenario file that separate a real loop from the paper's; every default is the ideal.

>>> SensingSection().force_lag
0.0
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, Literal

from pydantic import Field, Strict, model_validator

from coopmm_jax import parameters
from coopmm_jax.errors import UserError
from coopmm_jax.scenario.fields import Finite, NotNegative, Positive, Section, quantity
from coopmm_jax.scenario.sections.simulation import SimulationSection, is_whole

_hardware = parameters.Hardware()
Samples = Annotated[int, Strict(), Field(ge=0)]
Limit = Annotated[float, Strict(), Field(gt=0)]  # may be inf


class LoopSection(Section):
    """[loop]: how the controller runs."""

    control_period: NotNegative = quantity(0.0, "time between samples, torque held; 0: in continuous time [s]")

    def substeps(self, simulation: SimulationSection) -> int:
        """Integration steps in one control period; 0 in continuous time.

        Raises:
            UserError: the period is not a whole number of steps, or the duration not one of periods.
        """
        if self.control_period == 0.0:
            return 0
        ratio = self.control_period / simulation.step
        if not is_whole(ratio):
            must = f"0, or a whole number of simulation.step ({simulation.step:g} s)"
            raise UserError("loop.control_period", must, self.control_period)
        sample = self.control_period * simulation.record_every
        if not is_whole(simulation.duration / sample):
            must = f"a whole number of loop.control_period * record_every ({sample:g} s)"
            raise UserError("simulation.duration", must, simulation.duration)
        return round(ratio)


class SensingSection(Section):
    """[sensing]: what the controller measures; noise and delay need [loop] control_period."""

    force_lag: NotNegative = quantity(_hardware.force_lag, "time constant of the force sensor [s]")
    force_delay: Samples = quantity(0, "whole samples by which the measured force is late")
    force_bias: Finite = quantity(_hardware.force_bias, "offset of every measured constraint force [N]")
    force_noise: NotNegative = quantity(_hardware.force_noise, "standard deviation per sample [N]")
    encoder_noise: NotNegative = quantity(_hardware.encoder_noise, "of chained coordinates and joints [rad, m]")
    velocity_noise: NotNegative = quantity(_hardware.velocity_noise, "of independent velocities [rad/s, m/s]")


class ActuatorsSection(Section):
    """[actuators]: torque limits, lag and friction of wheels and joints."""

    wheel_limit: Limit = quantity(_hardware.wheel_limit, "largest wheel torque [N m]")
    joint_limit: Limit = quantity(_hardware.joint_limit, "largest joint torque [N m]")
    limit_form: Literal["hard", "smooth"] = quantity("hard", "clipped, or smoothly for gradients")
    lag: NotNegative = quantity(_hardware.actuator_lag, "time constant of every actuator [s]")
    wheel_viscous: NotNegative = quantity(_hardware.wheel_viscous, "viscous friction of a wheel [N m s]")
    joint_viscous: NotNegative = quantity(_hardware.joint_viscous, "viscous friction of a joint [N m s]")
    wheel_coulomb: NotNegative = quantity(_hardware.wheel_coulomb, "Coulomb friction of a wheel [N m]")
    joint_coulomb: NotNegative = quantity(_hardware.joint_coulomb, "Coulomb friction of a joint [N m]")
    friction_speed: Positive = quantity(_hardware.friction_speed, "below which Coulomb friction fades [rad/s]")


class ContactSection(Section):
    """[contact]: how the object's surface yields, rubs and moves, unknown to the controller."""

    model: Literal["rigid", "compliant"] = quantity(
        "rigid", "a constraint, which could pull as well, or a stiff surface that the tip can leave"
    )
    penetration: Positive = quantity(_hardware.penetration, "of the tip into a compliant surface at 15 N [m]")
    damping: NotNegative = quantity(
        _hardware.contact_damping, "share of a compliant surface's force for each m/s of the tip's speed into it [s/m]"
    )
    tip_friction: NotNegative = quantity(_hardware.tip_friction, "Coulomb coefficient along the surface [-]")
    slip_speed: Positive = quantity(_hardware.slip_speed, "sliding speed below which it fades [m/s]")
    surface_amplitude: Finite = quantity(
        _hardware.surface_amplitude, "a of a sin(w t + phase), by which it gives way [m]"
    )
    surface_frequency: Finite = quantity(_hardware.surface_frequency, "w of the surface's motion [rad/s]")
    surface_phase: Finite = quantity(_hardware.surface_phase, "phase of the surface's motion [rad]")


class HardwareSections(Section):
    """The four sections together."""

    loop: LoopSection = LoopSection()
    sensing: SensingSection = SensingSection()
    actuators: ActuatorsSection = ActuatorsSection()
    contact: ContactSection = ContactSection()

    def hardware(self, seed: int, stream: int) -> parameters.Hardware:
        """Every number of the four sections, as a rollout takes them."""
        sensing = {k: v for k, v in self.sensing if k != "force_delay"}
        actuators = {k: v for k, v in self.actuators if k not in ("limit_form", "lag")}
        contact = {k: v for k, v in self.contact if k not in ("model", "damping")}
        return parameters.Hardware(
            **sensing,
            **actuators,
            **contact,
            contact_damping=self.contact.damping,
            actuator_lag=self.actuators.lag,
            noise_seed=(float(seed >> 16), float(seed & 0xFFFF)),
            noise_stream=float(stream),
        )

    def features(self, varied: Collection[str] = ()) -> parameters.Features:
        """Parts of the hardware in force.

        Args:
            varied: fields ("sensing.force_lag") that an uncertainty changes, so that they count whatever their value.
        """

        def used(section: str, *fields: str) -> bool:
            values, ideal = getattr(self, section), type(getattr(self, section))()
            return any(
                getattr(values, field) != getattr(ideal, field) or f"{section}.{field}" in varied for field in fields
            )

        limited = used("actuators", "wheel_limit", "joint_limit")
        friction = (f"{part}_{kind}" for part in ("wheel", "joint") for kind in ("viscous", "coulomb"))
        return parameters.Features(
            force_lag=used("sensing", "force_lag"),
            force_bias=used("sensing", "force_bias"),
            noise=used("sensing", "force_noise", "encoder_noise", "velocity_noise"),
            torque_limits=limited and self.actuators.limit_form == "hard",
            smooth_limits=limited and self.actuators.limit_form == "smooth",
            actuator_lag=used("actuators", "lag"),
            friction=used("actuators", *friction),
            tip_friction=used("contact", "tip_friction"),
            surface_motion=used("contact", "surface_amplitude"),
        )

    @model_validator(mode="after")
    def _what_sampling_needs(self) -> HardwareSections:
        if self.loop.control_period > 0.0:
            return self
        for field in ("force_delay", "force_noise", "encoder_noise", "velocity_noise"):
            if getattr(self.sensing, field):
                raise UserError("loop.control_period", f"above 0 where sensing.{field} is used", 0.0)
        return self

    @model_validator(mode="after")
    def _what_the_force_loop_can_close(self) -> HardwareSections:
        if self.sensing.force_lag > 0.0 or self.sensing.force_delay > 0:
            return self
        must = "above 0 (or force_delay) where {} is used"
        if self.contact.tip_friction > 0.0 and self.actuators.lag == 0.0 and self.contact.model == "rigid":
            # Friction moves with the force it is asked to change, so an instantaneous force loop has no plain solution.
            raise UserError("sensing.force_lag", must.format("contact.tip_friction"), 0.0)
        if self.sensing.force_noise > 0.0:
            # Noise is drawn for a sample of the force; a loop closed in the same instant takes none.
            raise UserError("sensing.force_lag", must.format("sensing.force_noise"), 0.0)
        return self
