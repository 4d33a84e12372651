"""The engine of a hub: requests of programs go to the board, one after the other, and stops before all of them."""
