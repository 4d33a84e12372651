"""Many boards on many machines, through an MQTT broker."""
