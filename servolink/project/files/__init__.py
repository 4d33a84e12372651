"""The project file: one project as JSON that people can read."""
