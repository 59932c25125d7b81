"""What a person does at the window, from the first click to the last, with real firmware behind."""
