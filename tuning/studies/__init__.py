"""What is asked: tuned gains, a front, the worst sample, a comparison."""
