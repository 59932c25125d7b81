"""The health strip: supply, losses, rates and disk of the rig, each with its state."""
