"""Charts of a report's page: inline SVG that stays sharp, follows the theme, and can be hovered."""
