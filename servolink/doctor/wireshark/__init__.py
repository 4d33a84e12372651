"""A dissector for Wireshark, made from the declarations of the packets."""
