"""What connects the panels of a rig, a menu or a page to the window."""
