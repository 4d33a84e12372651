"""Studio: page on this machine in which people pose, build, try and save a robot (docs/design/studio.md)."""
