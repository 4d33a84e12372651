"""What is wrong with a project, found without a board."""
