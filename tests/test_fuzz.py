"""The command line under odd inputs of every kind, a few of those that ``experiments.fuzz`` can make."""

from experiments import fuzz_kinds
from experiments.fuzz import fuzz


def test_odd_inputs_end_in_one_line_or_pass():
    assert fuzz(700, seed=1) == []


def test_every_kind_loads_or_is_refused_in_one_line():
    found = {place.choice.group for place in fuzz_kinds.places()}
    assert found >= {"course", "disturbance", "path", "surface", "timing"}
    complaints, ends, loaded = fuzz_kinds.fuzz(cases=140, seed=2, rollouts=False)
    assert complaints == []
    assert 20 < ends["refused"] < 180
    fitting = [
        label for label in loaded if label.rpartition(" ")[2] in ("csv", "fourier", "steps", "table", "waypoints")
    ]
    assert all(loaded[label][0] > 0 for label in fitting)
