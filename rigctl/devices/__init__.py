"""The boards as a scientist names them: Drum and Taxels, and the ports they hang on."""
