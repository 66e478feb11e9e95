"""Times of results: ticks of encoders, and when a result begins."""
