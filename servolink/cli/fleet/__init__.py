"""Commands of a fleet: many boards, through an MQTT broker."""
