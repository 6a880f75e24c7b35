"""Sentences over signals, as requirements state them: how they are read, and by how much a rollout keeps them."""
