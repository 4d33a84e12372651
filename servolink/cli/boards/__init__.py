"""Commands that find, name, describe and examine boards."""
