"""Configuration: ``rig.toml``, TOML files in general, and the files that come with rigctl."""
