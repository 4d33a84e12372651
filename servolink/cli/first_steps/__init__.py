"""Commands for the first steps: the demo, help, and completion in the shell."""
