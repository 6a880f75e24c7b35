"""The equations become a rollout: closed loop, sampled loop, Runge-Kutta steps and a scan, of (11) under (12)-(24)."""
