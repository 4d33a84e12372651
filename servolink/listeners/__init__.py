"""Accept, bridge and hold back: TCP, local sockets and pseudo-terminals for whatever serves programs."""
