"""Commands that let programs and people use one board together."""
