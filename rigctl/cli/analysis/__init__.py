"""Commands that encode, analyse and classify recorded sessions."""
