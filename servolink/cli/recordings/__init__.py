"""Commands that make, show, replay and convert recordings."""
