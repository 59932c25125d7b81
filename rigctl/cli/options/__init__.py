"""Options, progress lines and prompts that several commands share."""
