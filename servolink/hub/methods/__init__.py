"""The methods of the control interface, as a hub carries them out."""
