"""Results: encoders, containers, streams carried over, files that appear when complete."""
