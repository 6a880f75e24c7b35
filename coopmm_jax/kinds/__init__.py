"""Kinds of things that a scenario chooses by name: the registry, and the built-in kinds, one file for each group."""
