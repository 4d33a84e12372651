"""Bytes to packets and back, without input or output, clock or logging.

Each chapter of the document has a file: `settings` 3.1, `servos` 3.2, `editing` 3.3, `joystick` 3.4. They declare
packets with `packet` and `records`. `layout` and `codec` turn packets into bytes; `parser` finds frames in a stream.
"""
