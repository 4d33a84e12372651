"""Search for boards, and names for them."""
