"""Cost that tuning minimises: of a rollout, its robust form over samples, and gains as a vector."""
