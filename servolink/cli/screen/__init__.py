"""Everything that draws on the terminal and reads its keys."""
