"""Many samples of a scenario's uncertainty: run, store, statistics, figures and report."""
