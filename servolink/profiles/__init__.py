"""What is known of each board, by the name that its user gave it."""
