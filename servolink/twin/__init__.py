"""Twin: the body of a robot with physics, made from the figure of a project."""
