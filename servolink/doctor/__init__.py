"""Why a board cannot be reached, and what to type."""
