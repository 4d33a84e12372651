"""The conversation with one board: who sends, which response belongs to which request, when to try again."""
