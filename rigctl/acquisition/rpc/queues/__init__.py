"""What is queued between an engine and its clients: a bounded amount on both sides."""
