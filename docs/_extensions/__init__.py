"""What the pages need beyond Sphinx, MyST and the theme."""
