"""Transfer between a project and a board: export, plan, apply, roll back."""
