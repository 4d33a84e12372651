"""Projects: everything stored on a board, as one object and as a file, and the ways from one to the other."""
