"""The window by keyboard alone: STOP by Esc, a focus that never jumps, and the regions."""
