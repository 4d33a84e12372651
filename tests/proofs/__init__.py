"""Long searches for faults, of which tests run a part: bad lines and boards, any bytes, hostile texts and boards."""
