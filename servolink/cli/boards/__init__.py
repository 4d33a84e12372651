"""Commands about boards: which are here, what they are known to be, and why one does not work."""
