"""Virtual board as a USB device, exported over USB/IP."""
