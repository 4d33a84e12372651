"""Engine of a hub: requests of programs go to the board in turn, and stops before all requests."""
