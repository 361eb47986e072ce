"""What is kept on disk of a search while it runs."""
