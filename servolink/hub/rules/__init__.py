"""Rules of a hub, without I/O and clock: lease, gates, order of requests, angle units."""
