"""The window's frame: heading, docks and pages, menus, settings of the user, and controllers."""
