"""Small widgets, themes and formats that several panels share."""
