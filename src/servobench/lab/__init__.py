"""The exercises: texts with blanks, experiments to fill them from, and the check of what was filled in."""
