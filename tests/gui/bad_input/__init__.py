"""What goes wrong at a rig: the window says what and what to do, and nothing recorded is lost."""
