"""Studies: tuned gains, a front, the worst sample, a comparison."""
