"""How a printed number is read off our own runs, so that both mean the same."""
