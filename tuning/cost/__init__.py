"""What tuning minimises: the cost of a rollout, its robust form over samples, and gains as a vector."""
