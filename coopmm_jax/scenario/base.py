"""All sections of a scenario as one, and what they become: the pytrees of ``parameters.py``.

>>> BaseScenario().parameters().gains.K_lambda
(0.3, 0.3, 0.3, 0.3)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any, Self

import tomli_w
from pydantic import SerializeAsAny, ValidationInfo, field_validator, model_validator

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.controllers import controller
from coopmm_jax.kinds.paths import ROUND, is_closed
from coopmm_jax.metrics.table import METRICS
from coopmm_jax.parameters import (
    MASS_NAMES,
    FrontInertia,
    Geometry,
    Inertia,
    MovingRail,
    Parameters,
    PathReference,
    Plant,
    Pose,
    Rail,
    Structure,
    Surface,
)
from coopmm_jax.scenario.overrides import laid_over
from coopmm_jax.scenario.replaced import affected, check_read
from coopmm_jax.scenario.sections.arm import ArmSection, check_joints, check_lists, starting_joints
from coopmm_jax.scenario.sections.controller import (
    DEFAULT,
    GainsSection,
    LawSection,
    NominalSection,
    full_gains,
    gains_section,
)
from coopmm_jax.scenario.sections.disturbance import Disturbances, paper_disturbance
from coopmm_jax.scenario.sections.hardware import HardwareSections
from coopmm_jax.scenario.sections.plant import CouplingSection, InitialSection, PlantSection
from coopmm_jax.scenario.sections.platform import PlatformSection
from coopmm_jax.scenario.sections.reference import ReferenceSection
from coopmm_jax.scenario.sections.requirements import RequirementsSection
from coopmm_jax.scenario.sections.schedule import ScheduleSection, schedule_section
from coopmm_jax.scenario.sections.simulation import SimulationSection
from coopmm_jax.scenario.sections.tuning import TuningSection, tuning_section
from coopmm_jax.scenario.sections.uncertainty import UncertaintySection
from coopmm_jax.scenario.validation import closest, validate
from coopmm_jax.temporal_logic.sentence import signals_of
from coopmm_jax.temporal_logic.signals import AFTERWARDS, check_joint


class BaseScenario(HardwareSections):
    """Sections of a scenario, which fit together; immutable and hashable. The defaults are the paper's section IV."""

    description: str = ""
    simulation: SimulationSection = SimulationSection()
    plant: PlantSection = PlantSection()
    platform: PlatformSection = PlatformSection()
    arm: ArmSection = ArmSection()
    coupling: CouplingSection = CouplingSection()
    nominal: NominalSection = NominalSection()
    law: LawSection = LawSection()
    gains: SerializeAsAny[GainsSection] = gains_section(DEFAULT)()
    schedule: SerializeAsAny[ScheduleSection] = schedule_section(DEFAULT)()
    disturbance: Disturbances = paper_disturbance()
    reference: ReferenceSection = ReferenceSection()
    initial: InitialSection = InitialSection()
    uncertainty: UncertaintySection = UncertaintySection()
    requirements: RequirementsSection = RequirementsSection()
    tuning: SerializeAsAny[TuningSection] = tuning_section(DEFAULT)()

    @property
    def steps(self) -> int:
        """Number of samples after the first: integration steps, or control periods where the loop is sampled."""
        return round(self.simulation.duration / self.sample_time)

    @property
    def sample_time(self) -> float:
        """Time between samples [s]: the integration step, or the control period where the loop is sampled."""
        return self.loop.control_period or self.simulation.step

    def with_overrides(self, changes: Mapping[str, Any]) -> Self:
        """Copy with some fields changed: ``scenario.with_overrides({"gains.K_lambda": 2})``.

        Args:
            changes: nested tables, or dotted names, to values.

        Raises:
            UserError: an unknown field, or a value it cannot have.
        """
        changed = affected({str(name).partition(".")[0] for name in changes})
        if "law" in changed:  # another controller has other sections
            changed = set(type(self).model_fields)
        tables = laid_over(self.model_dump(include=changed, exclude_none=True), changes)
        valid = {name: section for name, section in self if name not in changed}
        return validate(type(self), valid | tables)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Pickle the tables: classes of sections that are made for a controller have no name to be found by."""
        return validate, (type(self), self.model_dump(exclude_none=True))

    def to_toml(self) -> str:
        """Text of a scenario file that loads as an equal scenario, with every value spelt out."""
        return tomli_w.dumps(self.model_dump(exclude_none=True))

    def structure(self, varied: Collection[str] = ()) -> Structure:
        """Choices that change the equations themselves.

        Args:
            varied: fields ("sensing.force_lag") that an uncertainty changes, whose effects must be in force.
        """
        law = self.law
        return Structure(
            self.coupling.rows,
            law.robust_term,
            law.u26,
            law.feedforward,
            substeps=self.loop.substeps(self.simulation),
            force_delay=self.sensing.force_delay,
            features=self.features(varied),
            contact=self.contact.model,
            joints=self.arm.joints,
        )

    def parameters(self) -> Parameters:
        """Everything numeric, as Python floats in the pytree that a rollout takes."""
        return Parameters(
            plant=self._plant(),
            nominal=self.nominal_model(),
            gains=full_gains(dict(self), len(self.coupling.rows)),
            disturbance=tuple(entry.disturbance() for entry in self.disturbance),
            reference=self.reference.reference(self._surface()),
            start=_per_robot(Pose, {**dict(self.initial), "arm": starting_joints(self.arm, self.initial)}),
            hardware=self.hardware(self.simulation.seed, self.simulation.stream),
            schedule=self.schedule.schedule(len(self.coupling.rows), sum(self.arm.joints)),
        )

    def _plant(self) -> Plant:
        values = dict(self.plant)
        geometry = _per_robot(Geometry, values | {"front": self.platform.fronts(), "arm": self.arm.arms(values)})
        inertia = _inertias(values | {"front": self.platform.inertias(), "links": self.arm.inertias(values)})
        return Plant(geometry, inertia, self._surface(), self.plant.gravity, self._guide())

    def _surface(self) -> Surface:
        coupling, height = self.coupling, self.reference.height
        shape = coupling.surface.numbers() if coupling.surface else None
        over_time = coupling.guide_height if height is None else height.numbers()
        return Surface(coupling.contact_radius, coupling.guide_radius, over_time, shape)

    def _guide(self) -> Rail | MovingRail | None:
        reference = self.reference.reference(self._surface())
        if not isinstance(reference, PathReference):
            return None
        return (MovingRail if self.coupling.guide == "moving" else Rail)(reference.path, reference.timing)

    def nominal_model(self) -> tuple[Inertia, Inertia]:
        """Masses and inertias that the controller believes in."""
        plant = {name: _scaled(getattr(self.plant, name), self.nominal.scale) for name in MASS_NAMES}
        given = {name: value for name, value in self.nominal if name != "scale" and value is not None}
        front = self.platform.inertias(self.nominal.scale, {name: given.get(name) for name in FrontInertia._fields})
        links = self.arm.inertias(plant | given, self.nominal.scale, given)
        return _inertias(plant | given | {"front": front, "links": links})

    @field_validator("gains", "schedule", "tuning", mode="before")
    @classmethod
    def _of_the_controller(cls, value: Any, info: ValidationInfo) -> Any:
        made = _FOR_THE_CONTROLLER[info.field_name or ""]
        law = info.data.get("law")
        if law is None:  # what is wrong with it is told instead
            return made(DEFAULT)()
        return validate(made(law.controller), value) if isinstance(value, Mapping) else value

    @model_validator(mode="before")
    @classmethod
    def _with_the_controllers_sections(cls, data: Any) -> Any:
        """Let sections that are left out be those of the controller."""
        law = data.get("law") if isinstance(data, Mapping) else None
        if not isinstance(law, Mapping) or law.get("controller", DEFAULT) == DEFAULT:
            return data
        return {name: {} for name in _FOR_THE_CONTROLLER} | dict(data)

    @model_validator(mode="after")
    def _what_needs_a_path_has_one(self) -> Self:
        surface, guide = self.coupling.surface, self.coupling.guide
        for name, given in (("surface", surface and surface.kind), ("guide", guide)):
            if given is not None and self.reference.path is None:
                raise UserError(f"coupling.{name}", "left out without [reference.path]", given)
        return self

    @model_validator(mode="after")
    def _the_controller_steers(self) -> Self:
        made = controller(self.law.controller)
        if set(self.platform.kinds) != {"differential"} and made.plugin is None and "k4" not in made.fields:
            must = "one with backstepping (a gain k4), where a platform has two axles"
            raise UserError("law.controller", must, self.law.controller)
        return self

    @model_validator(mode="after")
    def _front_axles_turn_by_themselves_alone(self) -> Self:
        steer = self.initial.steer
        if steer is not None and set(self.platform.kinds) == {"differential"}:
            raise UserError("initial.steer", "left out of differential drives", steer)
        for angle in steer if isinstance(steer, tuple) else (steer,):
            if isinstance(angle, float) and not 0.0 < abs(angle) < 0.5 * math.pi:
                raise UserError("initial.steer", "to either side, by less than a right angle", angle)
        return self

    @model_validator(mode="after")
    def _arms_have_joints_and_numbers(self) -> Self:
        check_joints(self.arm, self.coupling.rows)
        given = {"nominal.m_links": self.nominal.m_links, "nominal.I_links": self.nominal.I_links}
        check_lists(self.arm, given | {"initial.pitch": self.initial.pitch}, self.initial.lift)
        return self

    @model_validator(mode="after")
    def _what_is_given_is_read(self) -> Self:
        check_read(self)
        return self

    @model_validator(mode="after")
    def _whole_periods_and_lists(self) -> Self:
        self.loop.substeps(self.simulation)
        full_gains(dict(self), len(self.coupling.rows))
        self.schedule.schedule(len(self.coupling.rows), sum(self.arm.joints))
        return self

    @model_validator(mode="after")
    def _a_controller_of_a_plugin_works(self) -> Self:
        if controller(self.law.controller).plugin is not None:
            from coopmm_jax.control.trial import try_controller  # imports JAX, which shipped controllers do without

            try_controller(self.structure(), self.parameters())
        return self

    @model_validator(mode="after")
    def _knots_within_a_turn(self) -> Self:
        phases, path = self.schedule.phases, self.reference.path
        if phases is None or (path is not None and not is_closed(path.numbers())):
            return self
        first, last = phases[0], phases[-1]
        if not last - first < ROUND[1]:
            raise UserError("schedule.phases", "within one turn of 2 pi on a closed path", f"{first:g} to {last:g}")
        return self

    @model_validator(mode="after")
    def _what_is_required_is_measured(self) -> Self:
        duration = self.simulation.duration
        for requirement in self.requirements.parsed():
            metric, sentence = requirement.metric, requirement.sentence
            if sentence is None and metric not in METRICS:
                must = f"a metric, as coopmm simulate --out writes them{closest(metric, METRICS)}"
                raise UserError(f"requirements.{metric}", must, "unknown")
            names = () if sentence is None else signals_of(sentence.form)
            for name in names:
                check_joint(name, self.arm.joints, f"requirements.{metric}")
            if any(name in AFTERWARDS for name in names):
                from coopmm_jax.proof.steps import check_loop  # imports JAX, which other requirements do without

                try:
                    check_loop(self.structure(), self.parameters())
                except UserError as error:
                    speaks = f"requirements.{metric}: {error.field}"
                    raise UserError(speaks, f"{error.must}, where a sentence speaks of the proof", error.was) from None
            if sentence is not None and sentence.reach() > duration:
                must = f"a sentence whose windows all begin within the {duration:g} s of the run"
                raise UserError(f"requirements.{metric}", must, f"one that looks {sentence.reach():g} s ahead")
        return self


_FOR_THE_CONTROLLER: dict[str, Callable[[str], type[Any]]] = {
    "gains": gains_section,
    "schedule": schedule_section,
    "tuning": tuning_section,
}


def _spread(value: Any, count: int) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,) * count


def _scaled(value: Any, factor: float) -> Any:
    return tuple(factor * entry for entry in value) if isinstance(value, tuple) else factor * value


def _per_robot(kind: type, values: Mapping[str, Any]) -> tuple[Any, Any]:
    """One ``kind`` for each robot, from numbers and pairs named as its fields."""
    columns = [_spread(values[name], 2) for name in kind._fields]
    return kind(*(first for first, _ in columns)), kind(*(second for _, second in columns))


def _inertias(values: Mapping[str, Any]) -> tuple[Inertia, Inertia]:
    return _per_robot(Inertia, {**values, "m_obj": (0.0, values["m_obj"])})  # robot II carries the object
