"""The finger board: its core on this computer and its image on a simulated Cortex-M7."""
