"""The drum's registers, safety states, polls and tare table."""
