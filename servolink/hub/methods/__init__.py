"""Methods of the control interface, carried out by a hub."""
