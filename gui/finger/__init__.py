"""The Finger tab: the texture recognised while a finger explores a plate."""
