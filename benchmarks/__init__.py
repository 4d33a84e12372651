"""What servolink costs, as ratios to something everybody knows, measured in the same run: `python -m benchmarks`."""
