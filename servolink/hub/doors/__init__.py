"""How programs reach a hub: a Unix socket, TCP and a pseudo-terminal."""
