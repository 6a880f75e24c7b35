"""The two robots, their coupling and how they move: (1)-(11), from kinematics to accelerations."""
