"""Numbers that say how good a rollout was, accumulated inside its scan."""
