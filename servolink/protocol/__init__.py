"""Bytes to packets and back: no input or output, no clock, no logging.

One file per chapter of the document (`settings` 3.1, `servos` 3.2, `editing` 3.3, `joystick` 3.4); `frame`,
`parser`, `packet`, `layout` and `codec` are what they are built on.
"""
