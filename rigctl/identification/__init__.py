"""Find the simulated bench's unknowns by what is known of real ones; see decision 0018."""
