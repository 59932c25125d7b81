"""A recorded trial or session in the same views as live samples, at any speed."""
