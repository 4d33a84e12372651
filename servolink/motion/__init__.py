"""Everything that is checked and computed before a movement is sent."""
