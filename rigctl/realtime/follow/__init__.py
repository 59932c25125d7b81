"""A session of the moving finger that another program records, followed in its folder."""
