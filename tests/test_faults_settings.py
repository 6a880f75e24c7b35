"""Settings mean what they say: what replaces what, what a command line spells, and one line for whatever is wrong."""

import numpy as np
import pytest

from coopmm_jax import errors
from coopmm_jax.cli import main
from coopmm_jax.commands.fields import takes_names
from coopmm_jax.errors import UserError
from coopmm_jax.scenario import overrides
from coopmm_jax.scenario.overrides import merged
from coopmm_jax.scenario.scenario import Scenario, load_scenario, shipped
from coopmm_jax.scenario.sections.platform import PlatformSection
from coopmm_jax.sweeps.run import sweep
from tuning.search.method import method

RELATIVE = 'plant.m_obj = { distribution = "uniform", low = 0.8, high = 1.2, relative = true }'
ABSOLUTE = {"distribution": "uniform", "low": 0.4, "high": 0.9}


def entry(scenario):
    """Everything that is set of the only distribution."""
    (found,) = scenario.uncertainty.entries()
    return found.distribution.model_dump(exclude_defaults=True)


@pytest.fixture
def base(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "base.toml").write_text(f"[uncertainty]\n{RELATIVE}\n[requirements]\nforce_min = '>= 0'\n")
    return load_scenario("base.toml")


def test_a_table_with_a_kind_replaces_the_one_it_inherits(base, tmp_path):
    text = 'base = "base.toml"\n[uncertainty]\nplant.m_obj = { distribution = "uniform", low = 0.4, high = 0.9 }\n'
    (tmp_path / "mine.toml").write_text(text)
    assert entry(load_scenario("mine.toml")) == ABSOLUTE
    assert entry(base.with_overrides({"uncertainty.plant.m_obj": ABSOLUTE})) == ABSOLUTE
    assert entry(base.with_overrides({"uncertainty": {"plant": {"m_obj": ABSOLUTE}}})) == ABSOLUTE
    assert entry(load_scenario("base.toml", uncertainty={"plant.m_obj": ABSOLUTE})) == ABSOLUTE


def test_one_number_of_an_inherited_distribution_can_still_be_changed(base):
    changed = base.with_overrides({"uncertainty.plant.m_obj.high": 1.3})
    assert entry(changed) == {"distribution": "uniform", "low": 0.8, "high": 1.3, "relative": True}


def test_entries_for_single_robots_replace_the_one_for_both_and_are_replaced_by_it():
    both = merged({"plant": {"m_p": ABSOLUTE}}, {"plant.m_p.1": ABSOLUTE})
    assert both == {"plant": {"m_p": {"1": ABSOLUTE}}}
    assert merged(both, {"plant.m_p": ABSOLUTE}) == {"plant": {"m_p": ABSOLUTE}}


def test_what_is_inherited_can_be_dropped(base):
    dropped = base.with_overrides(
        {"uncertainty.plant.m_obj": {"distribution": "none"}, "requirements.force_min": "none"}
    )
    assert dropped == Scenario()
    assert base.with_overrides({"nominal.m_p": 3.0}).with_overrides({"nominal.m_p": "none"}) == base
    one = base.with_overrides({"uncertainty.plant.m_p": {"1": ABSOLUTE, "2": ABSOLUTE}})
    other = one.with_overrides({"uncertainty.plant.m_p.1": {"distribution": "none"}})
    assert [found.name for found in other.uncertainty.entries()] == ["plant.m_obj", "plant.m_p.2"]


@pytest.mark.parametrize(("text", "value"), [(".5", 0.5), ("5.", 5.0), ("-.5e-3", -0.0005), ("+1.E2", 100.0)])
def test_numbers_as_everyone_writes_them(text, value):
    assert overrides.split(["--gains.k0", text]) == ([], {"gains.k0": value})


@pytest.mark.parametrize(
    ("arguments", "others", "changes"),
    [
        ("--gains.k0 4 small.toml", ["small.toml"], {"gains.k0": 4}),
        ("--gains.K-I 1 2 small.toml", ["small.toml"], {"gains.K_I": [1, 2]}),
        ("--law.u26 printed paper", ["paper"], {"law.u26": "printed"}),
        ("--tuning.gains K_I K_u --out x", ["--out", "x"], {"tuning.gains": ["K_I", "K_u"]}),
        ("--tuning.gains K_I small.toml", ["small.toml"], {"tuning.gains": "K_I"}),
        ("--requirements.force-min >=0 s.zarr", ["s.zarr"], {"requirements.force_min": ">=0"}),
    ],
)
def test_what_follows_a_value_is_one_only_where_it_can_be(arguments, others, changes):
    assert overrides.split(arguments.split(), lambda key: key == "tuning.gains") == (others, changes)


def test_a_choice_for_each_robot_is_two_names():
    arguments = ["help", "--platform.kind", "trailer", "car", "--scenario", "trailer"]
    others, changes = overrides.split(arguments, takes_names)
    assert (others, changes) == (["help", "--scenario", "trailer"], {"platform.kind": ["trailer", "car"]})
    # Another kind than the base's drops what the base has beside it.
    assert load_scenario("trailer", **changes).platform == PlatformSection(kind=("trailer", "car"))


def test_what_a_scenario_was_made_with_is_asked_for_where_that_may_be_missing(tmp_path, capsys):
    path = tmp_path / "worst.toml"
    path.write_text('# plugin own.py 5f2c\n[requirements]\nsmall = "always spread <= 0.5"\n')
    assert told(capsys, "simulate", str(path)) == (
        f"scenario: must be used with the --plugin own.py that {path} was made with (5f2c), was used without"
    )


def test_a_file_may_begin_with_a_byte_order_mark(tmp_path):
    (tmp_path / "bom.toml").write_bytes(b"\xef\xbb\xbf[gains]\nk0 = 3.0\n")
    assert load_scenario(tmp_path / "bom.toml").gains.k0 == 3.0


def test_numpys_whole_numbers_are_whole_numbers(scenario):
    with pytest.raises(UserError, match=r"^batch: must be a whole number, was 4\.5$"):
        sweep(scenario, samples=np.int64(8), keep=np.int8(0), batch=4.5)
    with pytest.raises(UserError, match=r"^batch: must be from 1 to 16777216, was 0$"):
        sweep(scenario, samples=np.int64(8), keep=np.int8(0), batch=np.int32(0))


def told(capsys, *arguments):
    """Message of a command that is refused, in one line and without "coopmm: error: "."""
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert len(err) < 500
    assert err.startswith("coopmm: error: ")
    return err.removeprefix("coopmm: error: ").rstrip("\n")


DEEP = "[" * 3000 + "]" * 3000
DIGITS = "1" + "0" * 5000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("sweep sensed --samples=--", "--samples: must be followed by a value, was followed by --"),
        ("simulate paper --gains-file=", "--gains-file: must be a path, was ''"),
        ("falsify paper --gains-file=", "--gains-file: must be a path, was ''"),
        ("tune paper --gains-file=", "--gains-file: must be a path, was ''"),
        ("sweep sensed --uncertainty=", "--uncertainty: must be a path, was ''"),
        (
            "simulate paper --gains.k0 -1 --gains.k1 -1 --plant.m-p 0",
            "plant.m_p: must be greater than 0, was 0 (wrong too: gains.k0)",
        ),
        (
            "init x.toml --scenario ellipse --reference.path.kind csv --reference.path.file 3",
            "reference.path.file: must be a string, was 3",
        ),
        ("simulate paper --tuning.bounds.k0 5", "tuning.bounds.k0: must be a list, was 5"),
        ("simulate paper --tuning.bounds.k0 1 2 3", "tuning.bounds.k0: must be a list of 2, was a list of 3"),
        ("simulate paper --plant.m-p 1 2 3", "plant.m_p: must be one number or a list of 2, was a list of 3"),
        ("simulate paper --tuning.gains 5", "tuning.gains: must be some of k0, k1, "),
        ("simulate paper --tuning.gains [[1]]", "tuning.gains: must be some of k0, k1, "),
        (
            'simulate paper --uncertainty.plant.m-p {distribution="uniform",low=1,high=2,relative="yes"}',
            'uncertainty.plant.m_p.relative: must be true or false, was "yes"',
        ),
        (
            "simulate sensed --requirements.object-rm none",
            "requirements.object_rm: must be one of contact_loss_fraction, force_error_rms_late, object_rms, "
            'error_late, to be dropped (did you mean object_rms?), was "none"',
        ),
        ("simulate paper --requirements.x none", "requirements.x: must be left out, as the base scenario has none"),
        (
            'simulate paper --requirements.force-min {require=">=0",scale=1e-320}',
            "requirements.force_min.scale: must be at least 1e-30, was 1e-320",
        ),
        (
            'simulate paper --requirements.force-min {require=">=0",scale=1e308}',
            "requirements.force_min.scale: must be at most 1e+30, was 1e+308",
        ),
        ("simulate paper --simulation.step 1e-310", "simulation.duration: must be less than 2147483648 steps"),
        ("simulate paper --simulation.duration 1e308", "simulation.duration: must be less than 2147483648 steps"),
        ("simulate paper --simulation.record-every 1" + "0" * 400, "simulation.record_every: must be less than 21474"),
        ("simulate paper --loop.control-period 1e308", "loop.control_period: must be 0, or a whole number of simula"),
        (f"simulate paper --gains.k0 {DIGITS}", 'gains.k0: must be a number, was "1000'),
        (f"simulate paper --gains.k0 0x{DIGITS}", "gains.k0: must be a number, was a number of more than 4300 digits"),
        (f"simulate paper --gains.k0 {DEEP}", 'gains.k0: must be a number, was "[[['),
        (f"simulate paper --{'a.' * 3000}b 1", "a.a.a."),
        (f"simulate {'x' * 10_000}.toml", "scenario: must be a file that can be read, was xxxx"),
        ("simulate ~nouser/x.toml", "scenario: must be a path of an existing user's folder, was ~nouser"),
        ("simulate \x1b[31m", f"scenario: must be one of {', '.join(sorted(shipped()))} or a .toml"),
        ("simulate paper --law.u26 \x1b[31m\x9b\udcff", r'law.u26: must be readable text, was "\x1b[31m\x9b\udcff"'),
    ],
)
def test_what_cannot_be_meant_is_one_line(arguments, message, capsys):
    assert told(capsys, *arguments.split(" ")).startswith(message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("one = 1\nlist = 2\n", "one: must be a section of the scenario, was unknown (wrong too: list)"),
        ('base = "\\u0000"\n', r"base: must be a path, was "),
        ('base = "none.toml"\n', "base: must be a file that can be read, was none.toml (No such file or directory)"),
        ('base = "loop.toml"\n', "base: must be a file that can be read, was loop.toml (Too many levels of symbolic"),
        (f"x = {DEEP}\n", "scenario: must be a TOML file, was bad.toml (nested too deeply)"),
        (f"x = {DIGITS}\n", "scenario: must be a TOML file, was bad.toml (Exceeds the limit"),
        ("a" + ".a" * 3000 + " = 1\n", "a: must be at most 20 tables deep, was deeper"),
        (f'description = 3\n["{"k" * 10**6}"]\n', "description: must be a string, was 3 (wrong too: kkk"),
        (f'[law]\nu26 = "{"λ" * 10**6}"\n', "law.u26: must be 'printed' or 'corrected', was \"λλλ"),
        ('[law]\nu26 = "\\u001b[31m"\n', r'''law.u26: must be 'printed' or 'corrected', was "\x1b[31m"'''),
    ],
)
def test_files_that_cannot_be_meant_are_one_line(text, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    (tmp_path / "bad.toml").write_text(text, encoding="utf-8")
    assert told(capsys, "simulate", "bad.toml").startswith(message)


def test_the_first_wrong_fields_are_named_and_the_rest_counted():
    with pytest.raises(UserError) as caught:
        Scenario().with_overrides({"gains": dict.fromkeys(("K_I", "k0", "k1", "k2", "k3", "beta"), -1)})
    wrong = "gains.k0: must be at least 0, was -1 (wrong too: gains.k1, gains.k2, gains.k3 and 2 more)"
    assert str(caught.value) == wrong


def test_a_long_chain_of_bases_is_read(tmp_path):
    for i in range(2000):
        base = f'base = "{i + 1}.toml"' if i < 1999 else 'base = "paper"'
        (tmp_path / f"{i}.toml").write_text(f"{base}\ngains.k0 = {i}.0\n")
    assert load_scenario(tmp_path / "0.toml").gains.k0 == 0.0


def test_any_text_becomes_one_short_printable_line():
    said = str(UserError("field\n" * 500, "what\tit must be " * 500, ["x" * 10**6] * 50, ["a" * 1000] * 9))
    assert len(said) <= errors.LONGEST
    assert said.isprintable()
    assert said.startswith("field field")


def test_distributions_that_overflow_are_refused_without_a_warning(capsys):
    law = 'uncertainty.plant.m-p={distribution="log_uniform",low=1e-300,high=1e300}'
    assert told(capsys, "simulate", "paper", f"--{law}").startswith("uncertainty.plant.m_p: must be ")


@pytest.mark.parametrize("name", ["rprop", "optimistic_adam", "power_iteration"])
def test_an_optimiser_that_takes_no_schedule_is_refused_with_one(name):
    with pytest.raises(UserError, match=rf"^tuning\.optimiser: must be .* that takes a schedule .*, was {name}$"):
        method(name, 0.1, "cosine", None, 100)


@pytest.mark.parametrize("decay", ["constant", "cosine"])
def test_an_optimiser_that_takes_a_schedule_is_not(decay):
    assert method("adam", 0.1, decay, 1.0, 100).start(np.zeros(3))
