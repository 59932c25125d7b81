"""Import of recordings that another program wrote, as sessions."""
