"""How well textures are told apart after so many trials, while a session grows."""
