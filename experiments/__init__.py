"""Studies that are run from the checkout: ``python -m experiments.reproduce_paper``."""
