"""Commands for developers: virtual boards, packets and measurements, and the demo."""
