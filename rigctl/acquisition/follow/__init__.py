"""A session that another program records, followed in its folder without a way to its rig."""
