"""Commands that record what happens, and tell what happened."""
