"""Accept connections, bridge conversations and apply back-pressure, on TCP, local sockets and pseudo-terminals."""
