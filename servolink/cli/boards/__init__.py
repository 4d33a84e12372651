"""Commands that find boards, name them, describe them and examine them."""
