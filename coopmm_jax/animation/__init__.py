"""Runs as films: scene, views and skeleton of the robots, and what writes them."""
