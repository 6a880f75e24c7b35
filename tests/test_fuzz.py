"""The command line under odd inputs of every kind, a few of those that ``experiments.fuzz`` can make."""

from experiments.fuzz import fuzz


def test_odd_inputs_end_in_one_line_or_pass():
    assert fuzz(2000, seed=0) == []
