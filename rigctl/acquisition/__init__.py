"""A protocol happening: engine, pump, live view, runner, client."""
