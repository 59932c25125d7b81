"""Trial protocols: parse ``protocols/*.toml`` into a plan of ordered steps."""
