"""The page that calibrates the connected rig, with the words of ``rigctl calibrate``."""
