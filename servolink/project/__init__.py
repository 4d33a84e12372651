"""Projects: everything stored on a board, as an object or a file, and the conversion between them."""
